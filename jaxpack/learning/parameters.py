"""What every network's weights are."""

Params = dict
"""Nested dict of float32 arrays."""

MASKED = -1e9
"""The score of what must not be chosen: a finite floor, -inf makes NaN gradients."""
