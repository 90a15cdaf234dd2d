"""Seconds from process start to the first finished chunk of updates, without and with the cache.

python benchmarks/startup.py [PRESET]

The same command three times in one empty cache folder: the first compiles, the others load.
A chunk is one update here, so that the time to the first line is the time to the first update.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def seconds_to_first_update(preset: str, folder: Path, name: str) -> float:
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(folder / "cache")}
    command = [sys.executable, "-m", "jaxpack.train", preset, "--chunk", "1"]
    command += ["--run", str(folder / name)]
    metrics = folder / name / "metrics.jsonl"
    start = time.perf_counter()
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    while not (metrics.exists() and metrics.read_text().count("\n")):
        time.sleep(0.01)
        if process.poll() is not None:
            raise SystemExit("training ended before its first update")
    seconds = time.perf_counter() - start
    process.kill()
    process.wait()
    assert json.loads(metrics.read_text().splitlines()[0])["update"] == 1
    return seconds


def main() -> None:
    preset = sys.argv[1] if len(sys.argv) > 1 else "bin-aware-2d"
    with tempfile.TemporaryDirectory() as folder:
        for name in ("cold", "warm", "warm again"):
            print(f"{preset}, {name}: {seconds_to_first_update(preset, Path(folder), name):.2f} s")


if __name__ == "__main__":
    main()
