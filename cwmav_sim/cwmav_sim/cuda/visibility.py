# SPDX-License-Identifier: Apache-2.0
"""Which particles see each other past thin walls: the rule of ``cwmav_sim.sph.visibility`` on the card."""

from __future__ import annotations

from numba import cuda


@cuda.jit(device=True, fastmath=True)
def hidden(signed_a, inside_a, a, signed_b, inside_b, b, mirrored, panels):
    """Tell whether a wall stands between two points.

    Parameters
    ----------
    signed_a, inside_a, signed_b, inside_b : array, shape (channels, points)
        Distances from the walls and inside their outlines [m].
    a, b : int
        Places of the two points.
    mirrored : bool
        Whether the second stands for its mirror image, in which a wall and its image swap places.
    panels : int
        Number of walls; channels beyond them are mirror images.
    """
    channels = signed_a.shape[0]
    found = False
    for c in range(channels):
        s_a = signed_a[c, a]
        source = c
        if mirrored:
            source = c + panels if c < panels else c - panels
        s_b = signed_b[source, b]
        if s_a * s_b < 0.0 and inside_a[c, a] * abs(s_b) + inside_b[source, b] * abs(s_a) > 0.0:
            found = True
    return found
