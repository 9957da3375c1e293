# SPDX-License-Identifier: Apache-2.0
"""Thin walls as the particles see them: quadrature elements and probes on moving triangles.

The triangles of every panel are divided into elements about a third of the particle spacing apart, fine
enough for the ray integrals of particles at 0.4 spacings from the wall. An element keeps its place in its
triangle (barycentric), its distance from the free edge of the panel in the reference state and the in-plane
direction away from that edge. The outline is set back by a fraction of the spacing, because the wall acts on
particles slightly beyond its edge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_sim.sph.placing import place_elements, triangle_areas

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Nodes(Protocol):
    """Position [m], velocity [m/s] and acceleration [m/s2] of the sheet nodes, shape (n, 3) each."""

    @property
    def x(self) -> FloatArray:
        """Positions [m], shape (n, 3)."""
        ...

    @property
    def v(self) -> FloatArray:
        """Velocities [m/s], shape (n, 3)."""
        ...

    @property
    def a(self) -> FloatArray:
        """Accelerations [m/s2], shape (n, 3)."""
        ...


class Motion(Protocol):
    """Triangulated sheets whose motion is known: what the solver needs of a wing."""

    @property
    def triangles(self) -> IntArray:
        """Node numbers of each triangle, shape (m, 3)."""
        ...

    @property
    def panel(self) -> IntArray:
        """Panel number of each triangle, shape (m,)."""
        ...

    @property
    def panel_names(self) -> tuple[str, ...]:
        """Names of the panels."""
        ...

    def state(self, t: float) -> Nodes:
        """Return the nodes at time ``t`` [s]."""
        ...


@runtime_checkable
class Solid(Protocol):
    """Walls that enclose room without air: bodies, or all that lies outside a vessel."""

    def holds(self, x: FloatArray) -> NDArray[np.bool_]:
        """Return which of the places ``x`` [m], shape (n, 3), lie in that room at time zero, shape (n,)."""
        ...


@dataclass(frozen=True)
class SheetLoad:
    """What the air does to the nodes of the sheets in one step.

    Attributes
    ----------
    force : ndarray, shape (n, 3)
        Forces [N], their mean over the step.
    carried : ndarray, shape (n,)
        Mass of air that a node carries along [kg]: how much its normal force falls per acceleration.
    """

    force: FloatArray
    carried: FloatArray


@runtime_checkable
class Compliant(Protocol):
    """Sheets that the air moves: a :class:`Motion` that must be told the loads."""

    def foresee(self, t: float, load: SheetLoad) -> None:
        """Foresee the motion until ``t`` [s] from the load at the begin of the step."""
        ...

    def accept(self, t: float, load: SheetLoad) -> None:
        """Go on to time ``t`` [s] under the load of the step that ends there."""
        ...


def expected_speed(motion: Motion | None, airspeed: float) -> float:
    """Return the highest speed of stream and walls [m/s], walls sampled over two periods of their motion."""
    if motion is None:
        return abs(airspeed)
    period = float(getattr(motion, "period", 1.0))
    instants = np.linspace(0.0, 2.0 * period, 193)
    walls = max(float(np.max(np.einsum("ij,ij->i", v, v))) for v in (motion.state(t).v for t in instants))
    return math.hypot(math.sqrt(walls), airspeed)


@dataclass(frozen=True)
class Elements:
    """Wall elements at one instant, m of them.

    Attributes
    ----------
    x, v, normal, inward : ndarray, shape (m, 3)
        Position [m], velocity [m/s], unit normal, in-plane unit vector away from the nearest edge.
    normal_acceleration : ndarray, shape (m,)
        Acceleration along the normal [m/s2].
    area : ndarray, shape (m,)
        Area [m2], in two dimensions length [m].
    """

    x: FloatArray
    v: FloatArray
    normal: FloatArray
    inward: FloatArray
    normal_acceleration: FloatArray
    area: FloatArray

    def relative_to(self, gravity: FloatArray) -> Elements:
        """Return the elements as seen in free fall at ``gravity`` [m/s2], shape (3,)."""
        if not gravity.any():
            return self
        return replace(self, normal_acceleration=self.normal_acceleration - self.normal @ gravity)


class SheetQuadrature:
    """Elements of all panels, placed anew for every state of the nodes.

    Parameters
    ----------
    motion : Motion
        The sheets; their state at time zero is the reference for distances within a panel.
    spacing : float
        Wanted distance between elements [m].
    probe_spacing : float
        Wanted distance between the probes for visibility [m].
    set_back : float
        Inward displacement of the free edges [m].
    dimensions : int
        In two dimensions a sheet is a strip along y; its area is taken per width of the strip.
    mirrored : bool
        An edge in the mirror plane y = 0 is no free edge: the sheet goes on behind it.
    faces : sequence of (int, float)
        Axis and place [m] of faces where a sheet goes on likewise, those of a periodic box.
    """

    def __init__(
        self,
        motion: Motion,
        *,
        spacing: float,
        probe_spacing: float,
        set_back: float,
        dimensions: int,
        mirrored: bool,
        faces: Sequence[tuple[int, float]] = (),
    ) -> None:
        self.panels = len(motion.panel_names)
        self._triangles = np.asarray(motion.triangles, dtype=np.int64)
        self._dimensions = dimensions
        reference = np.asarray(motion.state(0.0).x, dtype=np.float64)
        triangle, barycentric, share = _subdivide(reference, self._triangles, spacing)
        panel = np.asarray(motion.panel, dtype=np.int64)[triangle]
        x = np.einsum("ek,ekj->ej", barycentric, reference[self._triangles[triangle]])
        going_on = [*faces, (1, 0.0)] if mirrored else faces
        depth, inward = _edge_distance(
            x, panel, reference, self._triangles, motion.panel, dimensions, going_on
        )
        depth = depth - set_back
        self._width = _strip_width(reference) if dimensions == 2 else 1.0
        # An element straddling the set-back outline counts with the part that lies inside.
        extent = np.sqrt(_areas(reference, self._triangles)[triangle] * share)
        kept = np.clip(depth / extent + 0.5, 0.0, 1.0)
        use = kept > 0.0
        if not use.any():
            raise InputError(f"sheet: an edge set-back of {set_back:g} m leaves nothing of the panels")
        self.panel = panel[use]
        self.depth = depth[use]
        self._triangle = triangle[use]
        self._barycentric = barycentric[use]
        self._share = (share * kept)[use] / self._width
        self._inward = _in_triangle(inward[use], reference, self._triangles[self._triangle])
        self.probe = _thin_out(x[use], self.panel, probe_spacing)
        self.every = np.arange(len(self.panel))

    @property
    def count(self) -> int:
        """Number of elements."""
        return len(self.panel)

    def weights(self, nodes: int) -> sp.csr_matrix:
        """Return the share of each of ``nodes`` nodes in the position of every element, shape (m, n).

        Positions and velocities of the elements are this matrix times those of the nodes, so its transpose
        takes forces to the nodes without a change of force, moment or power.
        """
        row = np.repeat(np.arange(self.count), 3)
        column = self._triangles[self._triangle].ravel()
        return sp.csr_matrix((self._barycentric.ravel(), (row, column)), shape=(self.count, nodes))

    def nearest(self, placed: Elements, x: FloatArray, panel: IntArray) -> IntArray:
        """Return the element of the panel of each point ``x``, shape (k, 3), that is nearest to it."""
        found = np.empty(len(x), np.int64)
        for k, (point, p) in enumerate(zip(x, panel, strict=True)):
            mine = np.flatnonzero(self.panel == p)
            found[k] = mine[np.argmin(np.sum((placed.x[mine] - point) ** 2, axis=1))]
        return found

    def place(self, nodes: Nodes) -> Elements:
        """Return the elements for a state of the nodes."""
        x, v, a = (np.ascontiguousarray(values, np.float64) for values in (nodes.x, nodes.v, nodes.a))
        area, around = triangle_areas(x, self._triangles)
        placed = place_elements(
            x,
            v,
            a,
            around,
            area,
            self._triangles,
            self._triangle,
            self._barycentric,
            self._inward,
            self._share,
            self._dimensions == 2,
        )
        return Elements(*placed)


def _edges(x: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
    a, b, c = (x[triangles[:, k]] for k in range(3))
    return b - a, c - a


def _areas(x: FloatArray, triangles: IntArray) -> FloatArray:
    e1, e2 = _edges(x, triangles)
    return np.asarray(0.5 * np.linalg.norm(np.cross(e1, e2), axis=1))


def _strip_width(x: FloatArray) -> float:
    width = float(np.ptp(x[:, 1]))
    if width <= 0.0:
        raise InputError(
            "sheet: a sheet in two dimensions is a strip along y; its width is 0 m; allowed: > 0"
        )
    return width


def _subdivide(x: FloatArray, triangles: IntArray, spacing: float) -> tuple[IntArray, FloatArray, FloatArray]:
    """Divide each triangle into n^2 equal ones; return triangle, centroid and share of area of each."""
    e1, e2 = _edges(x, triangles)
    longest = np.max([np.linalg.norm(e, axis=1) for e in (e1, e2, e2 - e1)], axis=0)
    area = _areas(x, triangles)
    pieces = np.maximum(np.ceil(np.sqrt(area) / spacing), np.ceil(0.5 * longest / spacing)).astype(int)
    pieces = np.maximum(pieces, 1)
    triangle, barycentric, share = [], [], []
    for t, n in enumerate(pieces):
        centres = _centroids(int(n))
        triangle.append(np.full(len(centres), t))
        barycentric.append(centres)
        share.append(np.full(len(centres), 1.0 / len(centres)))
    return np.concatenate(triangle), np.concatenate(barycentric), np.concatenate(share)


def _centroids(n: int) -> FloatArray:
    """Barycentric centroids of the n^2 equal parts of a triangle."""
    out = []
    for i in range(n):
        for j in range(n - i):
            out.append((i + 1 / 3, j + 1 / 3))
            if i + j < n - 1:
                out.append((i + 2 / 3, j + 2 / 3))
    uv = np.array(out) / n
    return np.column_stack([1.0 - uv.sum(axis=1), uv])


def _boundary(triangles: IntArray) -> IntArray:
    """Edges that belong to one triangle only, shape (k, 2)."""
    edges = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
    )
    unique, count = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(unique[count == 1])


def _edge_distance(
    x: FloatArray,
    panel: IntArray,
    nodes: FloatArray,
    triangles: IntArray,
    triangle_panel: IntArray,
    dimensions: int,
    going_on: Sequence[tuple[int, float]],
) -> tuple[FloatArray, FloatArray]:
    """Distance of each element from the free edge of its panel, and the unit vector away from it.

    Without a free edge the distance is the extent of all sheets, and the vector zero.
    """
    distance = np.full(len(x), np.linalg.norm(np.ptp(nodes, axis=0)))
    inward = np.zeros_like(x)
    for p in np.unique(panel):
        mine = np.flatnonzero(panel == p)
        for first, second in _boundary(triangles[np.asarray(triangle_panel) == p]):
            a, b = nodes[first], nodes[second]
            along = b - a
            length2 = float(along @ along)
            if length2 == 0.0 or (dimensions == 2 and abs(along[1]) < 1e-9 * np.sqrt(length2)):
                continue  # the cut ends of a two-dimensional strip are no edges
            if any(max(abs(a[axis] - at), abs(b[axis] - at)) < 1e-9 for axis, at in going_on):
                continue
            share = np.clip((x[mine] - a) @ along / length2, 0.0, 1.0)
            away = x[mine] - a - share[:, None] * along
            r = np.linalg.norm(away, axis=1)
            closer = mine[r < distance[mine]]
            pick = r < distance[mine]
            inward[closer] = away[pick] / np.maximum(r[pick], 1e-30)[:, None]
            distance[closer] = r[pick]
    return distance, inward


def _in_triangle(vectors: FloatArray, x: FloatArray, corners: IntArray) -> FloatArray:
    """Components of vectors along the two edges of their triangle, shape (e, 2)."""
    e1, e2 = _edges(x, corners)
    g11, g12, g22 = (np.einsum("ej,ej->e", p, q) for p, q in ((e1, e1), (e1, e2), (e2, e2)))
    b1, b2 = (np.einsum("ej,ej->e", vectors, e) for e in (e1, e2))
    determinant = g11 * g22 - g12 * g12
    return np.column_stack([(g22 * b1 - g12 * b2) / determinant, (g11 * b2 - g12 * b1) / determinant])


def _thin_out(x: FloatArray, panel: IntArray, spacing: float) -> IntArray:
    """Pick, per panel, the element nearest to the centre of every cube of the given size."""
    cube = np.floor(x / spacing)
    off = np.linalg.norm(x / spacing - cube - 0.5, axis=1)
    by_offset = np.argsort(off, kind="stable")
    key = np.column_stack([panel, cube])[by_offset]
    _, first = np.unique(key, axis=0, return_index=True)
    return np.sort(by_offset[first])
