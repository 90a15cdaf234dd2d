"""The package from outside: what an import costs, the names it has, the commands it installs."""

import ast
import importlib
import inspect
import itertools
import re
import subprocess
import sys
import tomllib
import typing
from pathlib import Path

import pytest

import jaxpack
from jaxpack.__main__ import COMMANDS

ROOT = Path(__file__).parent.parent
HEAVY = {"numpy", "jax", "flax", "optax", "orbax", "matplotlib", "plotly", "tyro", "rich"}
TINY = '{"X": [1], "Y": [1], "Z": [1]}'
SOLVE = f"jaxpack.solve({TINY}, {TINY})"


def run(*arguments):
    """A fresh interpreter's (exit code, output, errors)."""
    command = [sys.executable, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    ("lines", "allowed"),
    [
        ("import jaxpack; jaxpack.__version__; dir(jaxpack)", set()),
        ("import jaxpack; jaxpack.Job, jaxpack.UserError", {"numpy"}),
        ("import jaxpack; jaxpack.pack", {"numpy", "jax"}),
        (f"import jaxpack; assert {SOLVE}.figures.bins == 1", {"numpy"}),
        ("import jaxpack.wave_process", {"numpy"}),
        ("import jaxpack.solve, jaxpack.stream, jaxpack.check", {"numpy", "tyro", "rich"}),
    ],
)
def test_nothing_is_imported_before_it_is_needed(lines, allowed):
    show = "import sys; print(*{name.split('.')[0] for name in sys.modules})"
    code, output, errors = run("-c", f"{lines}\n{show}")
    assert code == 0, errors
    assert set(output.split()) & HEAVY <= allowed


def names_for_type_checkers():
    """Name -> module of what `jaxpack/__init__.pyi` imports."""
    tree = ast.parse(Path(jaxpack.__file__).with_suffix(".pyi").read_text())
    return {
        alias.asname: importlib.import_module(line.module)
        for line in tree.body
        if isinstance(line, ast.ImportFrom)
        for alias in line.names
        if alias.name == alias.asname  # what makes it public for them
    }


PUBLIC = names_for_type_checkers()


def test_every_name_is_there_for_a_program_and_for_a_type_checker():
    assert sorted(PUBLIC) == jaxpack.__all__
    for name, home in PUBLIC.items():
        if name != "solve":  # shares its name with a module, below
            assert getattr(jaxpack, name) is getattr(home, name)
    assert set(jaxpack.__all__) <= set(dir(jaxpack))
    with pytest.raises(AttributeError, match="'choose_turned'"):
        jaxpack.choose_turned  # noqa: B018


# Made for jit: they refuse nothing.
PURE = {
    "sample",
    "make_train",
    "reset",
    "observe",
    "positions",
    "choice_of",
    "step",
    "decisions_of",
}


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_says_what_it_takes(name):
    thing = getattr(PUBLIC[name], name)
    text = inspect.getdoc(thing)
    assert text
    if not inspect.isclass(thing):
        for argument in inspect.signature(thing).parameters:
            assert re.search(rf"^ +([\w, ]+, )?{argument}(, [\w, ]+)?: ", text, re.MULTILINE), (
                argument
            )
        assert not inspect.signature(thing).parameters or "Raises:" in text or name in PURE
    elif not issubclass(thing, Exception):
        lines = inspect.getsource(thing).splitlines()
        for field in typing.get_type_hints(thing):
            if re.search(rf"^    {field}: ", text, re.MULTILINE):
                continue  # under "Attributes:"
            (at,) = [n for n, line in enumerate(lines) if re.match(rf"    {field}: ", line)]
            here = "  # " in lines[at] or lines[at - 1].startswith("    # ")
            assert here or lines[at + 1].startswith('    """'), field


OLD = [(home, name) for home, names in jaxpack._MOVED.items() for name in names.split()]


@pytest.mark.parametrize(("home", "name"), OLD)
def test_a_name_that_has_moved_still_works_and_says_where_it_is(home, name):
    with pytest.warns(DeprecationWarning, match=f"import it from {home}$") as warned:
        found = getattr(jaxpack, name)
    assert warned[0].filename == __file__
    assert found is getattr(importlib.import_module(home), name)
    assert name not in dir(jaxpack)


STATEMENTS = (
    "import jaxpack.solve",
    "from jaxpack import solve",
    "from jaxpack import *",
    "from jaxpack.solve import main",
    "jaxpack.solve",
)


def test_solve_can_be_called_whatever_was_imported_first(tmp_path):
    script = tmp_path / "orders.py"
    orders = ["\n".join(("import jaxpack", *some)) for some in itertools.permutations(STATEMENTS)]
    script.write_text(
        f"import sys\nfor lines in {orders!r}:\n"
        "    for name in [name for name in sys.modules if name.startswith('jaxpack')]:\n"
        "        if name in ('jaxpack', 'jaxpack.solve', 'jaxpack.solution'):\n"
        "            del sys.modules[name]\n"
        "    names = {}\n"
        "    exec(lines, names)\n"
        "    for solve in (names['solve'], names['jaxpack'].solve):\n"
        "        try:\n"
        f"            solve({TINY}, {TINY}, seed=-1)\n"
        "        except names['jaxpack'].UserError as error:\n"
        "            assert str(error).startswith('seed: -1'), error\n"
        "    assert callable(names['main']), lines\n"
        "print('done')\n"
    )
    code, output, errors = run(str(script))
    assert (code, output) == (0, "done\n"), errors


def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_the_installed_command_is_the_one_of_the_module():
    module, function = project()["scripts"]["jaxpack"].split(":")
    assert (
        getattr(importlib.import_module(module), function)
        is importlib.import_module("jaxpack.__main__").main
    )


START = "import sys; sys.argv[0] = '/bin/jaxpack'; from jaxpack.__main__ import main; main()"


@pytest.mark.parametrize("how", [("-m", "jaxpack"), ("-c", START)])
def test_the_command_says_what_there_is(how):
    code, output, errors = run(*how, "--help")
    assert (code, errors) == (0, "")
    for command in COMMANDS:
        assert re.search(rf"^  {command} +[a-z].*[a-z]$", output, re.MULTILINE)
    assert run(*how, "--version") == (0, f"jaxpack {jaxpack.__version__}\n", "")


@pytest.mark.parametrize(
    ("arguments", "start"),
    [
        ((), "no command"),
        (("sovle",), "no command 'sovle'"),
        (("--out", "p"), "no command '--out'"),
    ],
)
def test_an_unknown_command_is_one_line(arguments, start):
    code, output, errors = run("-m", "jaxpack", *arguments)
    assert (code, output) == (2, "")
    names = "solve, train, evaluate, stream, check, simulate, warm, serve"
    assert errors == f"error: {start}: give {names} or --help\n"


@pytest.mark.parametrize(
    ("how", "called"),
    [
        (("-m", "jaxpack", "solve"), "python -m jaxpack solve"),
        (("-m", "jaxpack.solve"), "python -m jaxpack.solve"),
        (("-c", START, "solve"), "jaxpack solve"),
    ],
)
def test_a_command_is_called_what_it_was_called_by(tmp_path, how, called):
    (tmp_path / "items.csv").write_text("X,Y,Z,COPIES\n1,1,1,8\n")
    (tmp_path / "bins.csv").write_text("X,Y,Z\n2,2,2\n")
    code, output, errors = run(*how, str(tmp_path / "items.csv"), str(tmp_path / "bins.csv"))
    assert code == 0, errors
    assert re.search(r"^bins +1$", output, re.MULTILINE), output
    code, output, errors = run(*how, "--time-limit", "soon")
    assert (code, output) == (2, "")
    assert errors.startswith("error: ")
    assert errors.endswith(f"; see {called} --help\n")
    assert errors.count("\n") == 1


def test_the_release_is_in_the_list_of_changes():
    headings = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert headings[0] == "Unreleased"
    assert jaxpack.__version__ in headings


def test_the_licence_is_the_one_declared():
    assert project()["license"] == "Apache-2.0"
    (name,) = project()["license-files"]
    text = (ROOT / name).read_text()
    assert "Apache License\n                           Version 2.0" in text
    assert "END OF TERMS AND CONDITIONS" in text
