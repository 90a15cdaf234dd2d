"""The README's library lines run as they stand."""

import re
from pathlib import Path

README = (Path(__file__).parent.parent / "README.md").read_text()


def test_the_library_lines_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len([line for line in block.splitlines() if line.strip()]) <= 14
    names: dict = {}
    exec(compile(block, "README.md", "exec"), names)
    assert names["packing"].bin.shape == names["instances"].mask.shape
    assert (names["bins"] >= 4).any()
    assert names["metrics"].outcome.cost.shape == (3, 1)
