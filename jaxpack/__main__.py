"""`jaxpack COMMAND`, also as `python -m jaxpack COMMAND`: the commands by name.

A command is imported when it is named, since each needs a second's worth of other packages.
"""

import sys
from importlib import import_module

from jaxpack import __version__

COMMANDS = {
    "solve": "pack a list of items into bins and write the checked plan",
    "train": "train a policy in a run folder",
    "evaluate": "compare methods on fresh instances",
    "stream": "pack a Parquet file of any number of orders into part files; goes on after a kill",
    "check": "check a plan of anyone against its items and bins",
    "simulate": "load a plan under gravity, and say what moved",
    "warm": "compile once, after an install, what solve would compile when it meets an order",
    "serve": "answer orders over HTTP with plans",
}
"""Name, also of the module whose `main` it is -> what it does."""
COMPUTE = ("train", "evaluate", "warm")  # with JAX, in this process

HELP = "\n".join([
    "usage: jaxpack COMMAND [OPTIONS]",
    "",
    *(f"  {name:9} {what}" for name, what in COMMANDS.items()),
    "",
    "jaxpack COMMAND --help says what it takes, jaxpack --version which release this is.",
])  # fmt: skip


def main() -> None:
    """Runs the command that the process was started with."""
    command, *rest = sys.argv[1:] or [""]
    if command in ("-h", "--help"):
        print(HELP)
    elif command == "--version":
        print(f"jaxpack {__version__}")
    elif command in COMMANDS:
        from jaxpack.cli import run_door

        try:
            door = import_module(f"jaxpack.{command}").main
        except KeyboardInterrupt:  # of a user who has seen at once what is wrong
            sys.exit(130)
        run_door(door, rest, computes=command in COMPUTE)
    else:
        wrong = f"no command '{command}'" if command else "no command"
        print(f"error: {wrong}: give {', '.join(COMMANDS)} or --help", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
