"""What the doors share: parsing with one-line errors, exit codes, the compilation cache."""

import contextlib
import gc
import io
import logging
import math
import os
import re
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from jaxpack.errors import UserError

T = TypeVar("T")

COLLECTED = 5_000, 20, 20  # objects more, and collections of the young, before the next ones


def parse_options(options: type[T], door: str, argv: Sequence[str]) -> T:
    """Options from the command line. Raises UserError where they are off; exits 0 after --help."""
    import tyro  # not for those who parse nothing

    printed, named = io.StringIO(), (tyro.conf.PositionalMetavarFromFieldName,)
    try:
        with contextlib.redirect_stderr(printed):
            return tyro.cli(options, prog=called(door), args=list(argv), config=named)
    except SystemExit as stop:
        if not stop.code:
            raise
    # tyro frames its errors and adds advice below a rule, and far to the right the help of every
    # option that it names: keep the sentence and which option may be meant, drop the rest. Where
    # a terminal has no lines to draw, rules are dashes and there is one below the title too.
    text = re.sub(r"\x1b\[[0-9;]*m", "", printed.getvalue())
    text = re.sub(r"(?m)^.? {9}.*\n", "", text)
    lines = [line.strip(" │|╭╮╰╯") for line in text.splitlines()]
    rules = [i for i, line in enumerate(lines) if i > 1 and line and not line.strip("─-")]
    end = rules[0] if rules else len(lines)
    sentence = " ".join(line for line in lines[1:end] if line.strip("-"))
    sentence = sentence.split(" Got errors:")[0].rstrip(".")
    close = [line.split()[0] for line in lines[end:] if re.match("--[a-z]", line)]
    if close and sentence.startswith("Unrecognized"):
        sentence += f" ({' or '.join(sorted(close))}?)"
    raise UserError(f"{sentence}; see {called(door)} --help")


def called(door: str) -> str:
    """How a door is called, as this process was: `jaxpack solve` or `python -m jaxpack.solve`."""
    script = Path(sys.argv[0])
    if script.stem == "jaxpack":
        return f"jaxpack {door}"
    whole = script.parts[-2:] == ("jaxpack", "__main__.py")
    return f"python -m jaxpack {door}" if whole else f"python -m jaxpack.{door}"


def run_door(
    door: Callable[[Sequence[str]], None],
    argv: Sequence[str] | None = None,
    computes: bool = True,
) -> None:
    """Runs a door: bad input is one line and exit code 2, an interrupt is exit code 130, and 141
    that nobody reads what it prints any more.

    Args:
        door: parses its options and does the work.
        argv: the options; those of the process if not given.
        computes: whether it uses JAX, in this process.
    """
    code = 0
    # What orbax logs on a damaged checkpoint or a full disk: the one line below says it.
    for name in ("absl", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    collect_seldom()
    try:
        if computes:
            prepare_jax()
        door(sys.argv[1:] if argv is None else argv)
    except UserError as error:
        line = "".join(c if c.isprintable() else "?" for c in " ".join(str(error).split()))
        print(f"error: {line}", file=sys.stderr)
        code = 2
    except KeyboardInterrupt:
        code = 130
    except BrokenPipeError:  # who was reading has seen enough
        code = 141
    except OSError as error:  # such as a full disk behind standard output
        print(f"error: {error.strerror or error}; make room, or write elsewhere", file=sys.stderr)
        code = 2
    if code:
        # At once: at the usual end the coroutines of a checkpoint that was cut short complain, and
        # one of several processes waits minutes for the others, which may be waiting for it.
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError):
                stream.flush()
        os._exit(code)


def collect_seldom() -> None:
    """Has the garbage collector pass over what the imports made, and look less often.

    Of many small objects that stay, such as those of orders, it would go through all again and
    again; a program is traced faster, too.
    """
    gc.freeze()
    gc.set_threshold(*COLLECTED)


def prepare_jax() -> None:
    """What every command does before its first array.

    Programs are kept between runs, see `cache_folder`, and a CPU runs them as `tune_for_cpu` says.
    """
    import jax  # a second

    from jaxpack.xla.environment import cache_folder
    from jaxpack.xla.programs import tune_for_cpu

    tune_for_cpu()
    # One that another process is writing at the moment, which JAX does in place: it compiles then.
    warnings.filterwarnings("ignore", "Error reading persistent compilation cache entry")
    jax.config.update("jax_compilation_cache_dir", str(cache_folder()))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def parse_whole(option: str, text: str) -> list[int]:
    """Whole numbers from "20,40,80". Raises UserError naming the option."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise UserError(
            f"--{option} '{text}': give whole numbers separated by commas, such as 20,40"
        ) from None


def parse_numbers(option: str, text: str) -> list[float]:
    """Numbers from "1e-3,3e-3". Raises UserError naming the option."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or not all(map(math.isfinite, numbers)):
        raise UserError(f"--{option} '{text}': give numbers separated by commas, such as 1e-3,3e-3")
    return numbers


def parse_sides(text: str) -> list[tuple[int, int]]:
    """Side ranges from "1-5,2-5". Raises UserError where they are not whole."""
    ranges = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(-?\d+)-(-?\d+)\s*", part)
        if not match:
            raise UserError(
                f"--sides '{text}': give whole cells as LOW-HIGH separated by commas, such as 1-5"
            )
        ranges.append((int(match[1]), int(match[2])))
    return ranges
