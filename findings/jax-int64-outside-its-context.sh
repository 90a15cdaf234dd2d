#!/usr/bin/env bash
# An int64 array that was made under `jax.enable_x64(True)` stays int64 when the context is left, but
# the first operation on it outside wraps it to 32 bits: 2**40 + 5 is less than 7 there. So does a
# jitted function that is called outside, though its argument is an int64 array.
# jax 0.10.2. One would have guessed that the context decides what new arrays become, and that an
# array keeps the bits it has: either the sum of an int64 array and 1 is int64, or it is an error.
# It is a UserWarning about a dtype that nobody has asked for.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet jax==0.10.2 jaxlib==0.10.2 numpy==2.4.6 > /dev/null 2>&1
cat > "$folder/show.py" << 'PYTHON'
import warnings

import jax
import jax.numpy as jnp

with jax.enable_x64(True):
    big = jnp.asarray([2**40 + 5], jnp.int64)
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    less = bool((big < 7)[0])
    more = big + 1
    jitted = jax.jit(lambda x: x + 1)(big)
with jax.enable_x64(True):
    inside = big + 1
print("jax", jax.__version__)
print("the array:             ", big.dtype, big)
print("less than 7, outside:  ", less)
print("plus 1, outside:       ", more.dtype, more)
print("plus 1, jitted outside:", jitted.dtype, jitted)
print("plus 1, inside:        ", inside.dtype, inside)
print("warnings:              ", len(told), told[0].category.__name__)
assert big.dtype == "int64" and int(inside[0]) == 2**40 + 6
assert less and more.dtype == jitted.dtype == "int32" and int(more[0]) == int(jitted[0]) == 6
PYTHON
JAX_PLATFORMS=cpu "$folder/venv/bin/python" "$folder/show.py"
