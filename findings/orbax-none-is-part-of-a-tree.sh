#!/usr/bin/env bash
# To JAX None is no leaf: a state that gains an optional field, None where it is not used, has the
# leaves that it had. To Orbax the field is a part of the tree: a checkpoint from before the field
# cannot be restored into the new state, although every array that is wanted is there. What the
# message says of the difference is "Source: MISSING, Target: MISSING".
# orbax-checkpoint 0.12.8 (with jax 0.10.2). One would have guessed that trees with the same leaves
# at the same paths are the same to a checkpoint.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet jax==0.10.2 jaxlib==0.10.2 orbax-checkpoint==0.12.8 > /dev/null 2>&1
cat > "$folder/show.py" << 'PYTHON'
import sys
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import orbax.checkpoint as ocp


class Before(NamedTuple):
    weights: Any
    step: Any


class Now(NamedTuple):
    weights: Any
    step: Any
    average: Any = None  # of no use in this run


before, now = (kind(jnp.ones(3), jnp.int32(1)) for kind in (Before, Now))
paths = [[jax.tree_util.keystr(path) for path, _ in jax.tree.leaves_with_path(one)] for one in (before, now)]
print("orbax-checkpoint", ocp.__version__, "leaves", *paths)
assert paths[0] == paths[1]
with ocp.StandardCheckpointer() as checkpointer:
    checkpointer.save(sys.argv[1] + "/checkpoint", before)
with ocp.StandardCheckpointer() as checkpointer:
    print("restored:", checkpointer.restore(sys.argv[1] + "/checkpoint", before))
    try:
        print("restored:", checkpointer.restore(sys.argv[1] + "/checkpoint", now))
    except ValueError as error:
        print("refused:", " ".join(str(error).split()))
PYTHON
JAX_PLATFORMS=cpu "$folder/venv/bin/python" "$folder/show.py" "$folder" 2> /dev/null | tee "$folder/out"
grep -q "^restored: Before" "$folder/out"
grep -q "^refused: .*average: - Source: MISSING - Target: MISSING" "$folder/out"
! grep -q "^restored: Now" "$folder/out"
echo "as described"
