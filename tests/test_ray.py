"""A real local cluster of Ray of two workers, one of which is killed on the way."""

import os
import signal
import sys
import threading
import time

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from test_stream import ROOM, made_orders

import jaxpack

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]  # Ray has some of its own


class PackOrders:
    """Packs, and says before each batch which process it is."""

    def __init__(self, bins, folder):
        self.bins, self.folder, self.calls = bins, folder, 0

    def __call__(self, batch):
        self.calls += 1
        (self.folder / f"{os.getpid()}-{self.calls}").touch()
        time.sleep(0.5)
        return jaxpack.solve_batch(batch, bins=self.bins, packings=4)


def test_a_worker_that_is_killed_in_a_batch_costs_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")  # or it writes to the home folder
    import ray

    calls = tmp_path / "calls"
    calls.mkdir()
    rows = jaxpack.orders_as_rows(made_orders(240))
    pq.write_table(rows, tmp_path / "rows.parquet")
    kills = []

    def kill():
        while not (found := [*calls.glob("*-2")]):
            time.sleep(0.02)
        kills.append(found[0].name.removesuffix("-2"))
        os.kill(int(kills[0]), signal.SIGKILL)

    here = {"env_vars": {"PYTHONPATH": os.pathsep.join(sys.path)}}
    ray.init(num_cpus=3, include_dashboard=False, log_to_driver=False, runtime_env=here)
    try:
        threading.Thread(target=kill, daemon=True).start()
        packed = ray.data.read_parquet(str(tmp_path / "rows.parquet"))
        packed = packed.repartition(target_num_rows_per_block=20).map_batches(
            PackOrders,
            fn_constructor_kwargs={"bins": ROOM, "folder": calls},
            batch_format="pyarrow",
            batch_size=20,
            concurrency=2,
        )
        found = pa.concat_tables(ray.get(packed.to_arrow_refs()))
    finally:
        ray.shutdown()
    begun = {path.name.partition("-")[0] for path in calls.iterdir()}
    assert len(kills) == 1
    assert len(begun) >= 3, "another one came in its place"
    expected = jaxpack.solve_batch(rows, bins=ROOM, packings=4)
    assert found.sort_by("ORDER").to_pylist() == expected.sort_by("ORDER").to_pylist()
