"""Items that are placed in a second by the two searches that nobody compiles, on one core.

python benchmarks/fillings.py [--data FOLDER] [--seconds 1]     (2 minutes)

Ivancic's 47 orders: bins by value, of which every lane of every filling counts, and annealing over
orders in NumPy, of which every packing counts with all its items. Seconds are CPU seconds.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).parent.parent / "experiments"))
from public_instances import IVANCIC, add_data_option, data_file, read_ivancic

from jaxpack.model.encoding import Loading, lane_genes, load_job
from jaxpack.model.rules import Rules
from jaxpack.search import beam, bin_values
from jaxpack.search.block_policy import shipped
from jaxpack.search.quick import quick_plan, search_quickly


def by_value(loading: Loading, seconds: float) -> Iterator[int]:
    """Items of every filling."""
    placed = 0

    fill = beam.fill

    def counted(kinds, goods, stop, now=None):
        nonlocal placed
        done = fill(kinds, goods, stop, now)
        placed += int((goods.count - done.left).sum())
        return done

    end = time.process_time() + seconds
    with patch.object(beam, "fill", counted):
        for _ in bin_values.search_values(
            loading, 0, lambda: time.process_time() > end, judge=shipped()
        ):
            pass
    yield placed


def by_order(loading: Loading, seconds: float) -> Iterator[int]:
    """Items of every packing."""
    end = time.process_time() + seconds
    first = quick_plan(loading, lane_genes(loading, 0, 0))
    for found in search_quickly(loading, 0, first, lambda: time.process_time() > end):
        yield len(loading.items) if found else 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_data_option(parser)
    parser.add_argument("--seconds", type=float, default=1.0)
    options = parser.parse_args()
    loadings = [load_job(job, Rules()) for job in read_ivancic(data_file(options.data, IVANCIC))]
    rates = {}
    for name, search in {"bins by value": by_value, "orders": by_order}.items():
        began = time.process_time()
        placed = sum(sum(search(loading, options.seconds)) for loading in loadings)
        rates[name] = placed / (time.process_time() - began)
        print(f"{name}: {rates[name]:,.0f} items a second", flush=True)
    print(f"ratio {rates['bins by value'] / rates['orders']:.1f}")


if __name__ == "__main__":
    main()
