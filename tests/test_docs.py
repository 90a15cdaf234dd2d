"""The README and the documentation: every block of code runs, every link leads somewhere."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = ["README.md", *sorted(f"docs/{page.name}" for page in (ROOT / "docs").glob("*.md"))]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
BLOCK = re.compile(r"(<!-- slow -->\n)?^```(\S*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PROJECT = ("LICENSE", "README.md", "examples", "jaxpack", "pyproject.toml", "tests")


def blocks(page):
    """(slow, language, text) of every block of a page."""
    return [(bool(slow), *rest) for slow, *rest in BLOCK.findall((ROOT / page).read_text())]


def pages_with(slow):
    """Those with blocks to run that are slow, or that are not."""
    return [p for p in PAGES if any(b[0] == slow and b[1] != "text" for b in blocks(p))]


COMPILED = ("docs/train.md",)
"""Pages whose commands compile for longer than they run."""


def surroundings(page, slow):
    """The environment of a command. The flags of the tests have XLA compile in no time what then
    runs for long: what is slow goes without, where running is what takes long.
    """
    ours = ("PYTEST", "XLA_FLAGS") if slow and page not in COMPILED else ("PYTEST",)
    return {name: value for name, value in os.environ.items() if not name.startswith(ours)}


def run(page, folder, block, names):
    """Runs a block of a page as somebody would who has just come to the project."""
    slow, language, text = block
    if language == "python":
        exec(compile(text, "a block of Python", "exec"), names)
    elif language == "sh":
        here = surroundings(page, slow)
        here["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        here["PYTEST_ADDOPTS"] = "tests/test_imports.py"  # where it runs tests, some
        command = ["bash", "-euo", "pipefail", "-c", text]
        done = subprocess.run(command, cwd=folder, env=here, capture_output=True, text=True)
        assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"


@pytest.fixture
def project(tmp_path, monkeypatch):
    for name in PROJECT:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=pytest.mark.long if page == "docs/evaluate.md" else ())
        for page in pages_with(slow=False)
    ],
)
def test_the_blocks_of_a_page_run(page, project):
    names: dict = {}
    for block in blocks(page):
        if not block[0]:
            run(page, project, block, names)
    if page == "README.md":
        assert names["solution"].figures.bins == names["solution"].bound == 1
        assert (project / "plan.html").stat().st_size > 100_000


@pytest.mark.slow
@pytest.mark.parametrize("page", pages_with(slow=True))
def test_all_blocks_of_a_page_run(page, project):
    names: dict = {}
    for block in blocks(page):
        run(page, project, block, names)


@pytest.mark.slow
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_a_notebook_runs(notebook, tmp_path):
    copy = shutil.copy(notebook, tmp_path)
    command = [sys.executable, "-m", "jupyter", "execute", copy]
    here = surroundings(notebook.name, slow=True)
    done = subprocess.run(command, env=here, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def code_of(page):
    """All Python of a page or a notebook, as one program."""
    if page.endswith(".ipynb"):
        cells = json.loads((ROOT / page).read_text())["cells"]
        return "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "code")
    return "\n".join(text for _, language, text in blocks(page) if language == "python")


@pytest.mark.long
def test_no_page_calls_what_is_not_there(tmp_path):
    """A name or a parameter that is gone, found before the slow tests run all that pages say."""
    for page in [*PAGES, *(str(path.relative_to(ROOT)) for path in NOTEBOOKS)]:
        if code := code_of(page):
            (tmp_path / f"{re.sub('[^a-z]', '_', page.lower())}.py").write_text(code)
    (tmp_path / "mypy.ini").write_text(
        "[mypy]\ncheck_untyped_defs = true\nignore_missing_imports = true\n"
        "follow_imports = silent\n"
    )
    command = [sys.executable, "-m", "mypy", "--config-file", str(tmp_path / "mypy.ini")]
    command += ["--cache-dir", str(tmp_path / "cache"), str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode <= 1, done.stdout + done.stderr
    # What else it says of types differs from release to release of what is called.
    wrong = re.findall(r".*\[(?:call-arg|attr-defined|name-defined)\]$", done.stdout, re.MULTILINE)
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_a_notebook_is_small_and_has_run_to_its_end(notebook):
    text = notebook.read_text()
    assert len(text) < 100_000
    cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert not [out for cell in cells for out in cell["outputs"] if out["output_type"] == "error"]


@pytest.mark.parametrize("page", [*PAGES, "CONTRIBUTING.md", "CHANGELOG.md", "benchmarks/NOTES.md"])
def test_links_lead_to_files_and_blocks_are_code_or_text(page):
    text = (ROOT / page).read_text()
    for link in re.findall(r"\]\((?![a-z]+:|#)([^)#\s]+)", text):
        assert ((ROOT / page).parent / link).is_file(), link
    assert {language for _, language, _ in blocks(page)} <= {"sh", "python", "text"}
    assert len(re.findall("^ *```", text, re.MULTILINE)) == 2 * len(blocks(page))


def test_the_readme_is_short_and_its_commands_are_those_that_others_rely_on():
    text = (ROOT / "README.md").read_text()
    assert len(text.encode()) <= 10_000
    install = "python3 -m venv .venv && .venv/bin/pip install -e "
    train, tests = (
        next(part for _, _, part in blocks("README.md") if part.startswith(start))
        for start in (f"{install}. && .venv/bin/python -m jaxpack.train\n", f"{install}'.[test]'")
    )
    assert train.count("\n") == tests.count("\n") == 1
    assert tests in (ROOT / ".ci" / "run").read_text()
