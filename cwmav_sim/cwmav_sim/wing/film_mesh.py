# SPDX-License-Identifier: Apache-2.0
"""Even triangulation of a panel for structural mechanics.

:func:`cwmav_sim.wing.geometry.mesh_panel` crowds its nodes towards the tip, which is harmless for a
prescribed wing; a film of the same triangles would have nodes a hundred times lighter than the rest. Here the
outline is divided evenly along its length, the inside is filled with a staggered grid, and both are joined by
a Delaunay triangulation, so that all triangles are nearly equilateral.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import Delaunay

from cwmav_common.errors import InputError
from cwmav_sim.wing.geometry import PanelMesh, WingPlanform
from cwmav_sim.wing.sheet import FloatArray

_CLEAR = 0.6  # least distance of inner nodes from the outline, over the spacing
_SLIVER = 1e-3  # triangles thinner than this share of an equilateral one lie on the straight outline


def even_mesh(planform: WingPlanform, spacing: float) -> PanelMesh:
    """Triangulate a panel with nodes about ``spacing`` [m] apart everywhere.

    The leading edge comes first in the node order, from root to tip; then the root edge from the leading to
    the trailing edge.

    Raises
    ------
    InputError
        The spacing is not positive, or above the root chord.
    """
    if not 0.0 < spacing <= planform.root_chord:
        raise InputError(
            f"wing: mesh spacing is {spacing:g} m; allowed: > 0 and <= root chord {planform.root_chord:g} m"
        )
    outline = _outline(planform, spacing)
    points = np.concatenate([outline, _inside(planform, spacing, outline)])
    triangles = Delaunay(points / spacing).simplices.astype(np.int64)
    area = _area(points, triangles)
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    triangles = triangles[np.abs(area) > _SLIVER * 0.25 * math.sqrt(3.0) * spacing**2]
    return PanelMesh(points[:, 0].copy(), points[:, 1].copy(), triangles)


def _outline(planform: WingPlanform, spacing: float) -> FloatArray:
    chord, tip = planform.root_chord, planform.length - planform.straight_to
    leading = _divided(planform.length - planform.root, spacing)
    root = _divided(chord, spacing)[1:]
    trailing = _divided(planform.straight_to - planform.root, spacing)[1:]
    angle = np.linspace(0.5 * math.pi, 0.0, 2001)
    arc = np.stack([planform.straight_to + tip * np.cos(angle), chord * np.sin(angle)], axis=1)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(arc, axis=0), axis=1))])
    along = _divided(float(length[-1]), spacing)[1:-1]
    curved = np.stack([np.interp(along, length, arc[:, k]) for k in range(2)], axis=1)
    return np.concatenate(
        [
            np.stack([planform.root + leading, np.zeros_like(leading)], axis=1),
            np.stack([np.full_like(root, planform.root), root], axis=1),
            np.stack([planform.root + trailing, np.full_like(trailing, chord)], axis=1),
            curved,
        ]
    )


def _divided(length: float, spacing: float) -> FloatArray:
    return np.linspace(0.0, length, max(1, round(length / spacing)) + 1)


def _inside(planform: WingPlanform, spacing: float, outline: FloatArray) -> FloatArray:
    """Staggered grid at a distance from the outline."""
    height = 0.5 * math.sqrt(3.0) * spacing
    rows = max(1, round(planform.root_chord / height))
    grid = []
    for j in range(1, rows):
        start = planform.root + (0.5 if j % 2 else 1.0) * spacing
        r = np.arange(start, planform.length, spacing)
        grid.append(np.stack([r, np.full_like(r, j * planform.root_chord / rows)], axis=1))
    points = np.concatenate(grid) if grid else np.empty((0, 2))
    below = points[:, 1] < planform.chord(points[:, 0])
    apart = np.linalg.norm(points[:, None] - outline[None], axis=2).min(axis=1, initial=np.inf)
    return np.asarray(points[below & (apart > _CLEAR * spacing)])


def _area(points: FloatArray, triangles: np.ndarray) -> FloatArray:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.asarray(
        0.5 * ((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
    )
