"""What the accelerator's benchmark takes for a run's operations."""

import jax
import jax.numpy as jnp

from benchmarks.accelerator import matrix_flops


def test_matrix_flops_count_what_a_loop_repeats_and_the_dearer_branch():
    left, right, bias = jnp.ones((3, 4)), jnp.ones((4, 5)), jnp.ones((2, 4, 4))

    def run(left, right, bias):
        def turn(left):
            return jax.lax.cond(left.sum() > 0, lambda x: x @ bias[0] @ bias[1], lambda x: x, left)

        left, _ = jax.lax.scan(lambda left, _: (turn(left), None), left, None, length=7)
        return jax.jit(jnp.matmul)(left, right)

    assert matrix_flops(run, left, right, bias) == 7 * 2 * (2 * 3 * 4 * 4) + 2 * 3 * 4 * 5
