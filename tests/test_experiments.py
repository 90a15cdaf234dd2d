"""The scripts over public instances, which are not in the repository: where they look for them."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SCRIPTS = [("solve_public.py", "2bp"), ("solve_public.py", "ivancic"), ("parts.py",)]
SCRIPTS += [("solve_public.py", "br"), ("solve_public.py", "bed"), ("fill_ideas.py",)]
SCRIPTS += [("public_tables.py",), ("peers.py",), ("physics.py",)]


@pytest.mark.parametrize("script", SCRIPTS, ids=" ".join)
def test_missing_instances_are_one_line_that_says_where_they_are_published(tmp_path, script):
    name, *options = script
    command = [sys.executable, str(ROOT / "experiments" / name), *options]
    done = subprocess.run(
        [*command, "--data", str(tmp_path)], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 1
    found = re.fullmatch(r"error: (.+): no such file; (\S+) says .*--data\n", done.stderr)
    assert found, done.stderr
    file, page = Path(found[1]), ROOT / found[2]
    assert file.parent == tmp_path
    assert f"| `{file.name}` |" in page.read_text()


def test_the_page_names_every_file_that_is_read():
    tree = ast.parse((ROOT / "experiments" / "public_instances.py").read_text())
    texts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    files = {text for text in texts if isinstance(text, str) and re.fullmatch(r"\w+\.\w+", text)}
    page = (ROOT / "docs" / "data.md").read_text()
    assert len(files) == 7
    rows = "".join(re.findall(r"^\| (`.+?) \|", page, re.MULTILINE))
    assert files == set(re.findall(r"`(.+?)`", rows))
