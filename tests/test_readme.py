"""The README's library lines run as they stand."""

import re
from pathlib import Path

README = (Path(__file__).parent.parent / "README.md").read_text()


BLOCKS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def run(block):
    names: dict = {}
    exec(compile(block, "README.md", "exec"), names)
    return names


def test_the_library_lines_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, block = BLOCKS
    assert len([line for line in block.splitlines() if line.strip()]) <= 14
    names = run(block)
    assert names["packing"].bin.shape == names["instances"].mask.shape
    assert (names["bins"] >= 4).any()
    assert names["metrics"].outcome.cost.shape == (3, 1)


def test_the_lines_that_solve_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    block, _ = BLOCKS
    found = run(block)["solution"]
    assert found.figures.bins == found.bound == 1
    assert (tmp_path / "plan.html").stat().st_size > 100_000
