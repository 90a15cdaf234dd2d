"""The kernel without a grid: a bin is the list of the top faces of what lies in it.

Lengths are whole units as fine as wanted: one placement costs by the number of items in the bin
and not by its resolution. The rule is the height map's: an item comes down from above, rests on
the highest face under its footprint, and enough of the footprint must lie on faces of exactly
that height. A face that is partly covered needs no care: whatever covers it is higher.

Arrays have a trailing batch axis B, as in `height_map`. M is the most items that a bin holds, X
and Y are numbers of candidate coordinates. A side of a bin has at most 2^30 units; areas have the
type of `needed`, int32 or int64, and must fit it.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.packing.height_map import Triple

NOWHERE = np.iinfo(np.int32).max
"""The resting height where an item is not allowed, the coordinate that is none."""
FARTHEST = 2**30 - 1  # of corners: far edges then fit int32


class Faces(NamedTuple):
    """What lies in one bin, seen from above; rows that are not used are all zero."""

    near_x: Array  # int32 [M, B], units
    far_x: Array
    near_y: Array
    far_y: Array
    top: Array
    used: Array  # int32 [B], rows in use


class Edges(NamedTuple):
    """Candidate coordinates along one axis, each once; the rest is NOWHERE."""

    at: Array  # int32 [M, B], units
    used: Array  # int32 [B], rows in use


def no_faces(most: int, batch: int) -> Faces:
    """An empty bin with room for `most` items."""
    nothing = jnp.zeros((most, batch), jnp.int32)
    return Faces(nothing, nothing, nothing, nothing, nothing, jnp.zeros(batch, jnp.int32))


def no_edges(most: int, batch: int) -> Edges:
    """The candidates in an empty bin: 0."""
    at = jnp.full((most, batch), NOWHERE, jnp.int32).at[0].set(0)
    return Edges(at, jnp.ones(batch, jnp.int32))


def add_edge(edges: Edges, far: Array, fits: Array) -> Edges:
    """With the far edge (int32 [B]) of what was placed where it fits."""
    new = fits & (edges.at != far).all(0)
    here = (jnp.arange(len(edges.at), dtype=jnp.int32)[:, None] == edges.used) & new
    return Edges(jnp.where(here, far, edges.at), edges.used + new.astype(jnp.int32))


def rest_on(faces: Faces, xs: Array, ys: Array, size: Triple, needed: Array, room: Triple) -> Array:
    """Resting height of an item at every candidate position, NOWHERE where it is not allowed.

    Args:
        xs, ys: int32 [X, B] and [Y, B], candidate coordinates of the corner.
        size: length, width, height of the item: int32 [B] each.
        needed: int32 or int64 [B], area that must lie on faces at the resting height. Where it is
            int64 this has to be called with x64 enabled.
        room: length, width, height of the bin: int32 [B] each.

    Returns:
        int32 [X, Y, B].
    """
    area_type = needed.dtype
    start = jnp.minimum(xs, FARTHEST)[:, None], jnp.minimum(ys, FARTHEST)[None]
    end = start[0] + size[0], start[1] + size[1]

    def under(row: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        """(the highest face so far, the area that lies on it) with one face more."""
        z, carried = found
        near_x, far_x, near_y, far_y, top = (column[row] for column in faces[:5])
        over_x = jnp.minimum(end[0], far_x) - jnp.maximum(start[0], near_x)
        over_y = jnp.minimum(end[1], far_y) - jnp.maximum(start[1], near_y)
        touches = (over_x > 0) & (over_y > 0) & (top >= z)
        area = over_x.astype(area_type) * over_y.astype(area_type)
        area += jnp.where(top == z, carried, 0)
        return jnp.where(touches, top, z), jnp.where(touches, area, carried)

    places = (len(xs), len(ys), xs.shape[-1])
    nothing = jnp.zeros(places, jnp.int32), jnp.zeros(places, area_type)
    z, carried = jax.lax.fori_loop(0, faces.used.max(), under, nothing)
    floor = size[0].astype(area_type) * size[1].astype(area_type)
    carried = jnp.where(z == 0, floor, carried)
    inside = (xs <= room[0] - size[0])[:, None] & (ys <= room[1] - size[1])
    allowed = inside & (z <= room[2] - size[2]) & (carried >= needed)
    return jnp.where(allowed, z, NOWHERE)


def lowest_corner(xs: Array, ys: Array, z: Array) -> tuple[Triple, Array]:
    """Minimum z, then y, then x: ((x, y, z) int32 [B] each, fits bool [B])."""
    z_best = z.min((0, 1))
    at_best = z == z_best
    y_best = jnp.where(at_best, ys, NOWHERE).min((0, 1))
    x_best = jnp.where(at_best & (ys == y_best), xs[:, None], NOWHERE).min((0, 1))
    return (x_best, y_best, z_best), z_best < NOWHERE


def put_on(faces: Faces, size: Triple, corner: Triple, fits: Array) -> Faces:
    """The faces after an item of `size` has come to rest at `corner`, where it fits."""
    x, y, z = corner
    row = jnp.arange(len(faces.top), dtype=jnp.int32)[:, None]
    here = (row == faces.used) & fits

    def write(column: Array, value: Array) -> Array:
        return jnp.where(here, value, column)

    return Faces(
        near_x=write(faces.near_x, x),
        far_x=write(faces.far_x, x + size[0]),
        near_y=write(faces.near_y, y),
        far_y=write(faces.far_y, y + size[1]),
        top=write(faces.top, z + size[2]),
        used=faces.used + fits.astype(jnp.int32),
    )


def first_edges(edges: Edges, rows: int) -> Array:
    """The candidates where no more than so many rows are in use: int32 [rows, B]."""
    return edges.at[:rows]
