"""Imports point one way: commands -> io -> search -> learning -> packing -> model, xla."""

import ast
from pathlib import Path

import jaxpack

ROOT = Path(jaxpack.__file__).parent
DOORS = {"train", "evaluate", "solve", "check", "warm", "serve", "stream", "simulate"}
TOP = {
    "methods",
    "comparison",
    "tables",
    "plan_tables",
    "training",
    "solution",
    "cli",
    "orders",
    "plan_files",
    "search_process",
    "wave_process",
    "workers",
    "many",
    "waves",
    "flags",
    "rule_flags",
    "parts",
    "batches",
    "train_options",
    "train_sweep",
    "sweeping",
    "sweep_report",
    "gym",
    "following",
    "online",
}
BELOW = {"model", "packing", "search", "learning", "io", "xla", "errors"}
ALLOWED = {
    "errors": set(),
    "model": {"errors", "model"},
    "xla": {"errors", "xla"},
    "packing": {"errors", "model", "xla", "packing"},
    "learning": {"errors", "model", "xla", "packing", "learning"},
    "search": BELOW - {"io"},
    "io": BELOW,
    **dict.fromkeys(TOP, BELOW | TOP),
    "service": BELOW | TOP | {"service", "__version__"},
    **dict.fromkeys(DOORS, BELOW | TOP),
    "stream": BELOW | TOP | {"__version__"},
    "serve": BELOW | TOP | {"service"},
    "__init__": BELOW | TOP,
    "__main__": {"__version__"} | TOP,
}


def parts_imported(source):
    """The parts of the package that a module imports, wherever in its text it does so."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        for name in names:
            package, part, *_ = [*name.split("."), "", ""]
            if package == "jaxpack":
                yield part


def test_imports_point_one_way():
    modules = sorted(ROOT.rglob("*.py"))
    assert {path.relative_to(ROOT).parts[0].removesuffix(".py") for path in modules} == set(ALLOWED)
    for path in modules:
        part = path.relative_to(ROOT).parts[0].removesuffix(".py")
        wrong = set(parts_imported(path.read_text())) - ALLOWED[part]
        assert not wrong, f"{path.relative_to(ROOT)} imports {', '.join(sorted(wrong))}"


def test_the_reader_of_imports_sees_every_form():
    source = "import jaxpack.train as t\ndef f():\n    from jaxpack import evaluate\nimport os"
    assert sorted(parts_imported(source)) == ["evaluate", "train"]
