"""Orders packed side by side against one after the other, on one core.

python benchmarks/waves.py [--data FOLDER] [--every 8] [--packings 4]     (1 minute)

Every eighth mail order, so many packings each: all in one wave, and each in a wave of its own, with
the same plans; then the bins of their first passes filled in NumPy and by the program that XLA
compiles for one device, which must hold the same. Seconds are CPU seconds of this process.
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "experiments"))
from public_instances import add_data_option, read_bookshop

from jaxpack.model.encoding import load_job
from jaxpack.search.beam import fill
from jaxpack.search.bin_values import values_asked
from jaxpack.search.device_fill import DeviceFill
from jaxpack.search.portfolio import SolveOptions
from jaxpack.search.together import fill_together
from jaxpack.search.wave import pack_wave


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """(CPU seconds, what comes of it)."""
    began = time.process_time()
    done = work()
    return time.process_time() - began, done


def never() -> bool:
    """Does not stop anything."""
    return False


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_data_option(parser)
    parser.add_argument("--every", type=int, default=8)
    parser.add_argument("--packings", type=int, default=4)
    options = parser.parse_args()
    jobs = read_bookshop(options.data)[:: options.every]
    how = SolveOptions(packings=options.packings)
    together, wave = timed(lambda: pack_wave(jobs, how))
    alone, each = timed(lambda: [pack_wave([job], how)[0] for job in jobs])
    assert [one.plan for one in wave] == [one.plan for one in each]
    print(f"{len(jobs)} orders side by side: {len(jobs) / together:,.0f} orders a CPU second")
    print(f"one after the other: {len(jobs) / alone:,.0f}; ratio {alone / together:.1f}")

    asked = [next(values_asked(load_job(job), 0, never, draws=(4,))) for job in jobs]
    bins = sum(len(one.goods.limit) for one in asked)
    device = DeviceFill(1)
    fill_together(asked, never, device)  # compiles
    rates, full = {}, []
    for name, how_to in {"NumPy": fill, "XLA": device}.items():
        seconds, done = timed(lambda how_to=how_to: fill_together(asked, never, how_to))
        rates[name] = bins / seconds
        full.append(done)
        print(f"bins filled by {name}: {rates[name]:,.0f} a CPU second", flush=True)
    for one, other in zip(*full, strict=True):
        np.testing.assert_array_equal(one.left, other.left)
    print(f"ratio {rates['NumPy'] / rates['XLA']:.1f}")


if __name__ == "__main__":
    main()
