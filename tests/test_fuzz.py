"""Whatever a file or a table holds, nothing but a UserError of one line comes out."""

VALID = {
    "a.csv": (ITEMS_2D, ITEMS_3D, BINS_2D, BINS_3D, SOLID_CERTIFICATE),
    "a.ins2D": (INS2D,),
    "a.json": (json.dumps(ORDERS), json.dumps(ORDERS, indent=1)),
}
TOKENS = (
    *(",", "\n", "\r", '"', ";", "\t", "\0", "-", "-1", "0", "1e999", "nan", "Infinity", " "),
    *("{", "}", "[", "]", ":", "null", "true", "\\ud800", "\ufeff", "9" * 5000, "x", "é", "1e7"),
)
EDITS = st.lists(
    st.tuples(st.floats(0, 1), st.integers(0, 6), st.sampled_from(TOKENS)), min_size=1, max_size=3
)


def edited(text, edits):
    """The text with pieces of it replaced by tokens."""
    for where, length, token in edits:
        start = int(where * len(text))
        text = text[:start] + token + text[start + length :]
    return text.encode()


CONTENTS = {
    name: st.one_of(
        st.binary(max_size=60),
        st.text(alphabet=st.sampled_from("XYZWIDTHEGHT,;\n\"' 0123.-+e[]{}:"), max_size=60).map(
            str.encode
        ),
        *(EDITS.map(lambda edits, text=text: edited(text, edits)) for text in texts),
    )
    for name, texts in VALID.items()
}


def assert_read_or_refused(call):
    try:
        return call()
    except UserError as error:
        assert_one_line(error)
        return None


@settings(deadline=None, max_examples=300)
@given(data=st.data(), name=st.sampled_from(sorted(CONTENTS)))
def test_any_file_is_read_or_refused_in_one_line(data, name):
    text = data.draw(CONTENTS[name])
    bins = data.draw(st.one_of(st.none(), st.just(BINS_2D), st.just(BINS_3D), CONTENTS["a.csv"]))
    with tempfile.TemporaryDirectory() as folder:
        jobs = assert_read_or_refused(lambda: read(Path(folder), text, bins, name))
        for job in jobs or ():
            assert 1 <= job.count <= 100_000
            sides = [side for kind in (*job.items, *job.bins) for side in kind.size]
            assert all(0 < side <= 1e9 for side in sides)


@pytest.fixture(scope="module")
def plan_files(tmp_path_factory):
    """What is written of the plans, with what reads it."""
    folder = tmp_path_factory.mktemp("plans")
    written = []
    for number, (job, plan) in enumerate(((FLAT_JOB, FLAT_PLAN), (SOLID_JOB, SOLID_PLAN))):
        for write, again in (
            (write_certificate, read_certificate),
            (write_plan_json, read_plan_json),
        ):
            path = folder / f"{number}-{write.__name__}"
            write(path, job, plan)
            written.append((path.read_text(), job, again))
    return written


@settings(deadline=None, max_examples=200)
@given(edits=EDITS, data=st.data())
def test_any_plan_is_read_or_refused_in_one_line(plan_files, edits, data):
    text, job, again = data.draw(st.sampled_from(plan_files))
    with tempfile.TemporaryDirectory() as folder:
        path = file_with(Path(folder), "plan", edited(text, edits))
        assert_read_or_refused(lambda: again(path, job))


CELLS = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3), st.binary(max_size=2)
)
COLUMNS = st.sampled_from(["X", "Y", "Z", "WIDTH", "HEIGHT", "COPIES", "WEIGHT", "ROTATION_XYZ"])


@settings(deadline=None, max_examples=200)
@given(
    st.one_of(
        CELLS,
        st.dictionaries(COLUMNS, st.one_of(CELLS, st.lists(CELLS, min_size=1, max_size=2))),
        st.lists(st.dictionaries(COLUMNS, CELLS), max_size=3),
    )
)
def test_any_columns_are_read_or_refused_in_one_line(table):
    assert_read_or_refused(lambda: job_from_columns(table, BOXES))
    assert_read_or_refused(lambda: job_from_columns(BOXES, table))
