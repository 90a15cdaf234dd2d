#!/usr/bin/env bash
# A Parquet file of twelve row groups that is read with `override_num_blocks=12` is one
# block: an actor pool of two behind it packs all of it with one actor.
# ray 2.60.0. One would have guessed that the option, which a warning of Ray Data itself advises for
# this, makes twelve blocks. `repartition(target_num_rows_per_block=...)` makes them.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet 'ray[data]==2.60.0' pyarrow==26.0.1 > /dev/null 2>&1
cat > "$folder/show.py" << 'PYTHON'
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import ray

file = Path(sys.argv[1]) / "rows.parquet"
pq.write_table(pa.table({"number": list(range(240))}), file, row_group_size=20)
ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)


def blocks(dataset):
    """How many there are behind a function that is mapped."""
    return len(dataset.map_batches(lambda batch: batch, batch_size=20).to_arrow_refs())


asked = blocks(ray.data.read_parquet(str(file), override_num_blocks=12))
cut = blocks(ray.data.read_parquet(str(file)).repartition(target_num_rows_per_block=20))
print("row groups:", pq.ParquetFile(file).num_row_groups)
print("blocks with override_num_blocks=12:", asked)
print("blocks with repartition:           ", cut)
assert asked == 1 and cut == 12
PYTHON
RAY_AUTH_MODE=disabled "$folder/venv/bin/python" "$folder/show.py" "$folder" 2> "$folder/log" || { tail -5 "$folder/log"; exit 1; }
