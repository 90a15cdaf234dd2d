#!/usr/bin/env bash
# An entry of JAX's persistent compilation cache that was cut short, as by a process that was killed
# while it wrote one, is never written anew: whoever needs that program compiles it again, run after
# run, and is warned each time. Entries are written in place and without a lock, and what is there is
# not replaced; a second process that reads while a first one writes gets the same warning.
# jax 0.10.2 (0.12.0.1 is the same). One would have guessed that an entry appears whole, or that one that cannot be read is
# replaced by what was compiled instead.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet jax==0.10.2 jaxlib==0.10.2 > /dev/null 2>&1
cat > "$folder/show.py" << 'PYTHON'
import sys
import warnings
from pathlib import Path

import jax
import jax.numpy as jnp

jax.config.update("jax_compilation_cache_dir", sys.argv[1])
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def program(x):
    return jnp.sin(x) * 2 + 1


with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    jax.jit(program)(jnp.ones(8)).block_until_ready()
unread = [str(one.message) for one in told if "program" in str(one.message)]
entry = next(Path(sys.argv[1]).glob("jit_program-*-cache"))
print(f"{entry.stat().st_size:6} bytes, warned: {bool(unread)} {' '.join(unread)[:75]}")
PYTHON
run() { JAX_PLATFORMS=cpu "$folder/venv/bin/python" "$folder/show.py" "$folder/cache"; }
{ run; run; } | tee "$folder/whole"
entry=$(ls "$folder"/cache/jit_program-*-cache)
truncate -s -100 "$entry"
echo "the entry is 100 bytes shorter now"
{ run; run; run; } | tee "$folder/short"
! grep -q 'warned: True' "$folder/whole"
test "$(grep -c 'warned: True' "$folder/short")" = 3
test "$(awk '{ print $1 }' "$folder/short" | sort -u | wc -l)" = 1
