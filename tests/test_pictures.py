"""Writing pictures and pages leaves what a program of one's own does with matplotlib alone."""

import os
import subprocess
import sys

import pytest

PLAN = """
import sys
from pathlib import Path
from jaxpack import BinType, ItemType, Job, PackedBin, Placement, Plan
sides = ((2.0, 1.0, 2.0), (4.0, 1.0, 4.0)) if {dimension} == 2 else ((2.0,) * 3, (4.0,) * 3)
job = Job((ItemType(sides[0], 1),), (BinType(sides[1]),), {dimension}, "job")
plan = Plan((PackedBin(0, (Placement(0, "XYZ", (0.0, 0.0, 0.0)),)),))
"""
PAGE = """
from jaxpack.io.viewer import write_html
write_html(Path("plan.html"), job, plan)
assert not any(name.partition(".")[0] == "matplotlib" for name in sys.modules)
"""
PICTURES = """
import matplotlib
matplotlib.use("svg")  # somebody's own choice
settings = dict(matplotlib.rcParams)
import jax.numpy as jnp
from jaxpack import Problem, make_instance, pack
from jaxpack.io.pictures import draw_packings, write_png
write_png(Path("plan.png"), job, plan)
problem = Problem(bin=(4, 1, 4) if {dimension} == 2 else (4, 4, 4))
instance = make_instance(problem, [[2] * len(problem.axes)])
draw_packings(Path("grid.png"), [("one", instance, pack(problem, instance, jnp.arange(1)))])
for name in ("plan", "grid"):
    assert Path(name + ".png").read_bytes().startswith(b"\\x89PNG")
assert matplotlib.get_backend() == "svg"
assert settings == dict(matplotlib.rcParams)
assert "matplotlib.pyplot" not in sys.modules
"""


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("program", [PAGE, PICTURES], ids=["page", "pictures"])
def test_matplotlib_stays_as_it_was(program, dimension, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", (PLAN + program).format(dimension=dimension)],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert done.returncode == 0, done.stderr
