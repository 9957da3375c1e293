# SPDX-License-Identifier: Apache-2.0
"""Planform of one wing panel and its triangulation.

A panel is described by the distance r from the hinge axis and the distance s behind the straight leading
edge. The chord is constant to ``straight_to`` and falls elliptically to zero at the tip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cwmav_common.errors import InputError
from cwmav_common.settings import setting
from cwmav_sim.wing.sheet import FloatArray, IntArray


@dataclass(frozen=True)
class WingPlanform:
    """Settings of one wing panel."""

    model: str = setting(
        "prescribed",
        "prescribed: follows a law of twist; membrane: film and rods as finite elements, moved by the air; "
        "lattice: rigid facets, ball joints and springs, moved by the air",
        choices=("prescribed", "membrane", "lattice"),
    )
    length: float = setting(0.140, "distance from the hinge axis to the tip", unit="m", gt=0)
    root: float = setting(0.020, "distance from the hinge axis to the inner end of the film", unit="m", gt=0)
    root_chord: float = setting(0.085, "chord of the straight part", unit="m", gt=0)
    straight_to: float = setting(
        0.100, "distance from the hinge axis where the tip ellipse begins", unit="m", gt=0
    )
    nodes_per_spacing: float = setting(1.0, "mesh nodes per particle spacing", ge=0.25, le=4)

    def __post_init__(self) -> None:
        if not self.root < self.straight_to < self.length:
            raise InputError(
                f"wing: root {self.root:g} m, straight_to {self.straight_to:g} m, length {self.length:g} m; "
                "allowed: root < straight_to < length"
            )

    def chord(self, r: FloatArray) -> FloatArray:
        """Return the chord [m] at distances ``r`` [m] from the hinge axis."""
        share = np.clip((r - self.straight_to) / (self.length - self.straight_to), 0.0, 1.0)
        return self.root_chord * np.sqrt(1.0 - share**2)

    @property
    def area(self) -> float:
        """Area of the panel [m2]."""
        tip = 0.25 * math.pi * (self.length - self.straight_to) * self.root_chord
        return (self.straight_to - self.root) * self.root_chord + tip


@dataclass(frozen=True)
class PanelMesh:
    """Triangulated panel in its own coordinates.

    Attributes
    ----------
    r, s : ndarray, shape (n,)
        Distance from the hinge axis and behind the leading edge of each node [m].
    triangles : ndarray, shape (m, 3)
        Node numbers, counter-clockwise in (r, s).
    """

    r: FloatArray
    s: FloatArray
    triangles: IntArray


def mesh_panel(planform: WingPlanform, spacing: float) -> PanelMesh:
    """Triangulate a panel with nodes about ``spacing`` [m] apart.

    Span stations crowd towards the tip as the ellipse steepens; the tip itself is one node, where the
    chord vanishes.
    """
    if not spacing > 0:
        raise InputError(f"wing: mesh spacing is {spacing:g} m; allowed: > 0 m")
    r = _stations(planform, spacing)
    rows = max(1, round(planform.root_chord / spacing))
    share = np.linspace(0.0, 1.0, rows + 1)
    inner = r[:-1]
    node_r = np.append(np.repeat(inner, rows + 1), planform.length)
    node_s = np.append(np.outer(planform.chord(inner), share).ravel(), 0.0)
    return PanelMesh(node_r, node_s, _connect(len(inner), rows))


def _stations(planform: WingPlanform, spacing: float) -> FloatArray:
    straight = planform.straight_to - planform.root
    inner = np.linspace(planform.root, planform.straight_to, max(1, round(straight / spacing)) + 1)
    tip = planform.length - planform.straight_to
    angles = np.linspace(0.0, 0.5 * math.pi, max(3, round(1.3 * tip / spacing)) + 1)
    return np.concatenate([inner, planform.straight_to + tip * np.sin(angles[1:])])


def _connect(columns: int, rows: int) -> IntArray:
    triangles = []
    for i in range(columns - 1):
        for j in range(rows):
            a, b = i * (rows + 1) + j, (i + 1) * (rows + 1) + j
            triangles += [(a, b, b + 1), (a, b + 1, a + 1)]
    tip, last = columns * (rows + 1), (columns - 1) * (rows + 1)
    triangles += [(last + j, tip, last + j + 1) for j in range(rows)]
    return np.array(triangles, dtype=np.int64)
