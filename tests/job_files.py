"""Jobs in the forms of files, and how tests read them."""

import signal
from contextlib import contextmanager

import pytest

from jaxpack.errors import UserError
from jaxpack.io.jobs import read_job
from jaxpack.model.job import (
    FLAT_TURNED,
    UPRIGHT,
    BinType,
    ItemType,
    Job,
    PackedBin,
    Placement,
    Plan,
)

ITEMS_2D = "ID,WIDTH,HEIGHT,COPIES,WEIGHT,ORIENTED\na,3,5,2,1.5,1\nb,4.25,2,1,0,0\n"
BINS_2D = "WIDTH,HEIGHT,COST,COPIES,MAXIMUM_WEIGHT\n10,12,-1,-1,-1\n6,6,7.5,3,20\n"
ITEMS_3D = (
    "X,Y,Z,COPIES,ROTATION_XYZ,ROTATION_YXZ,ROTATION_ZYX,ROTATION_YZX,ROTATION_XZY,ROTATION_ZXY\n"
    "3,4,5,2,1,1,0,0,0,0\n1,2,3,1,0,0,0,1,0,1\n"
)
BINS_3D = "X,Y,Z\n10,10,10\n"
INS2D = "3\n10 12\n1 3 5 1 1 15\n2 4 2 3 3 8\n3 1 1 1 1 1\n"
FLAT_JOB = Job(
    items=(
        ItemType((3.0, 1.0, 5.0), 2, 1.5, ("XYZ",), "a"),
        ItemType((4.25, 1.0, 2.0), 1, 0.0, FLAT_TURNED, "b"),
    ),
    bins=(BinType((10.0, 1.0, 12.0)), BinType((6.0, 1.0, 6.0), 7.5, 3, 20.0)),
    dimension=2,
    name="items",
)
SOLID_JOB = Job(
    items=(
        ItemType((3.0, 4.0, 5.0), 2, orientations=UPRIGHT),
        ItemType((1.0, 2.0, 3.0), 1, orientations=("YZX", "ZXY")),
    ),
    bins=(BinType((10.0, 10.0, 10.0)),),
    name="items",
)


def ordered(number, article="jam-7", sides=(600, 400, 220), weight=6.5):
    length, width, height = sides
    return {
        "article": article,
        "id": article[-1],
        "product_group": "food",
        "length/mm": length,
        "width/mm": width,
        "height/mm": height,
        "weight/kg": weight,
        "sequence": number,
    }


ORDERS = {
    "0017": {
        "item_sequence": {
            "1": ordered(1),
            "2": ordered(2, "tea-8", (300, 200, 100), 2),
            "3": ordered(3),
            "4": ordered(4, sides=(600, 400, 221)),
        },
        "properties": {"id": "5", "target": "rollcontainer"},
    },
    "0018": {"item_sequence": {"1": ordered(1)}, "properties": {"target": "euro-pallet"}},
    "0019": {"item_sequence": {"1": ordered(1)}},
}


def file_with(folder, name, text):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def read(folder, items, bins=None, name="items.csv", **how):
    given_bins = None if bins is None else file_with(folder, "bins.csv", bins)
    return read_job(file_with(folder, name, items), given_bins, **how)


def notes_of(folder, items, bins=None, name="items.csv", **how):
    """The job of the files and all that was said of them."""
    notes = []
    (job,) = read(folder, items, bins, name, say=notes.append, **how)
    assert all(line.isprintable() for line in notes)
    return job, notes


def assert_one_line(error, *words):
    (line,) = str(error).splitlines()
    assert line.isprintable(), line
    for word in words:
        assert word in line, line


def assert_refused(call, *words):
    with pytest.raises(UserError) as stop:
        call()
    assert_one_line(stop.value, *words)


FLAT_PLAN = Plan(
    bins=(
        PackedBin(1, (Placement(0, "XYZ", (0.0, 0.0, 0.0)),)),
        PackedBin(0, (Placement(1, "ZYX", (0.5, 0.0, 0.0)), Placement(0, "XYZ", (2.5, 0.0, 4.25)))),
    )
)
FLAT_CERTIFICATE = """\
TYPE,ID,COPIES,BIN,X,Y,LX,LY,GROUP_ID
BIN,1,1,0,0,0,24,24,
ITEM,0,1,0,0,0,12,20,0
BIN,0,1,1,0,0,40,48,
ITEM,1,1,1,2,0,8,17,0
ITEM,0,1,1,10,17,12,20,0
"""
SOLID_PLAN = Plan(
    bins=(
        PackedBin(0, (Placement(0, "YXZ", (0.0, 0.0, 0.0)), Placement(1, "ZXY", (4.0, 0.0, 5.0)))),
    ),
    left_out=(0,),
)
SOLID_CERTIFICATE = """\
TYPE,ID,COPIES,BIN,X,Y,Z,LX,LY,LZ,ROTATION
BIN,0,1,0,0,0,0,10,10,10,
ITEM,0,1,0,0,0,0,4,3,5,YXZ
ITEM,1,1,0,4,0,5,3,1,2,ZXY
"""


@contextmanager
def stopped_after(seconds):
    """Fails what computes for longer than that: for what never ends, or takes hours."""
    late = []

    def stop(signum, frame):
        late.append(signum)
        raise TimeoutError

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
        assert not late, f"it computes for more than {seconds} s"  # whoever took it for an error
