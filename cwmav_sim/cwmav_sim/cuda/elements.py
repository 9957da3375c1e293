# SPDX-License-Identifier: Apache-2.0
"""Wall elements on the card: placed from the nodes, sorted by wall and cell, and the cells around them.

Only the nodes of the wings travel to the card. Which corners an element has, where it lies between them and
what share of their triangle it stands for never change, so that is taken once from the quadrature of
``cwmav_sim.sph.sheet`` in the reference state.
"""

from __future__ import annotations

import math

import numpy as np
from numba import cuda
from numpy.typing import NDArray

from cwmav_sim.cuda.cells import CardGrid, CellSort, cell_number, place_of
from cwmav_sim.cuda.integrate import around
from cwmav_sim.cuda.launch import CardArray, empty, launch, upload
from cwmav_sim.cuda.nodes import CardNodes
from cwmav_sim.sph.sheet import Motion, Nodes, SheetLoad, SheetQuadrature
from cwmav_sim.sph.wall import ELEMENT_ROWS

# Rows of placed elements: position, velocity, normal, inward direction, acceleration along the normal, area.
PLACED_X, PLACED_V, PLACED_N, PLACED_INWARD, PLACED_ALONG, PLACED_AREA = 0, 3, 6, 9, 12, 13
PLACED_ROWS = 14
PROBE_ROWS = 10  # position, normal, inward direction, distance inside the outline


class CardElements:
    """Elements and probes of all walls.

    Parameters
    ----------
    quadrature, motion : SheetQuadrature, Motion
        The walls and their motion.
    grid : CardGrid
        Cells.
    gravity : float
        Acceleration along -z [m/s2].
    dtype : numpy.dtype
        Precision of the pairs.

    Attributes
    ----------
    rows, column, cell_of : array, shape (11, m), (m,) and (m,)
        Elements in the order of walls and cells, as ``cwmav_sim.sph.wall`` names the rows; their columns and
        the numbers of their cells.
    panel : array, shape (m,), int32
        Wall of every element, by place.
    sort, probe_sort : CellSort
        Their order, and that of the probes; the cells of wall p begin at p times the number of cells.
    probes, probe_column : array, shape (10, k) and (k,)
        Probes likewise.
    """

    def __init__(
        self, quadrature: SheetQuadrature, motion: Motion, grid: CardGrid, gravity: float, dtype: np.dtype
    ) -> None:
        reference = motion.state(0.0)
        self.panels, self.count = quadrature.panels, quadrature.count
        self._grid, self._gravity = grid, gravity
        self._flat = grid.integers[4] == 0
        corners, weights, inward, share = _in_triangles(quadrature, reference)
        self._corners, self._weights = upload(corners.astype(np.int32)), upload(weights)
        self._inward, self._share = upload(inward), upload(share)
        self._of_panel = upload(quadrature.panel.astype(np.int32))
        self._nodes = CardNodes(np.asarray(motion.triangles), corners, weights, len(reference.x))
        self._placed = empty((PLACED_ROWS, self.count))
        self._key = empty(self.count, np.int32)
        self._probe, self._depth = (
            upload(quadrature.probe.astype(np.int32)),
            upload(quadrature.depth[quadrature.probe]),
        )
        probes = len(quadrature.probe)
        self.sort = CellSort(self.count, self.panels * grid.cells)
        self.probe_sort = CellSort(probes, self.panels * grid.cells)
        self.rows, self.column = empty((ELEMENT_ROWS, self.count), dtype), empty(self.count, dtype)
        self.cell_of, self.panel = empty(self.count, np.int32), empty(self.count, np.int32)
        self.probes, self.probe_column = empty((PROBE_ROWS, probes), dtype), empty(probes, dtype)

    def node_load(self, reaction: CardArray, load: SheetLoad) -> None:
        """Bring the reactions (4, m) of the elements, by number, to the nodes of a load on the card."""
        self._nodes.load(reaction, load)

    def place(self, nodes: Nodes) -> None:
        """Bring all elements to a state of the nodes, on the host or on the card, and sort them."""
        grid = self._grid
        self._nodes.take(nodes)
        launch(
            _place,
            self.count,
            self._nodes.rows,
            self._nodes.normal,
            self._corners,
            self._weights,
            self._inward,
            self._share,
            self._of_panel,
            self._flat,
            self._gravity,
            grid.low,
            grid.size,
            grid.cell,
            grid.integers,
            self._placed,
            self.sort.key,
        )
        self.sort.sort()
        launch(
            _pack_elements,
            self.count,
            self._placed,
            self.sort.key,
            self.sort.order,
            grid.cells,
            grid.low,
            grid.cell,
            grid.integers,
            self.rows,
            self.column,
            self.cell_of,
            self.panel,
        )
        launch(_pick, self._probe.shape[0], self._probe, self.sort.key, self.probe_sort.key)
        self.probe_sort.sort()
        launch(
            _pack_probes,
            self._probe.shape[0],
            self._placed,
            self._probe,
            self._depth,
            self.probe_sort.key,
            self.probe_sort.order,
            grid.cells,
            grid.low,
            grid.cell,
            grid.integers,
            self.probes,
            self.probe_column,
        )


def _in_triangles(
    quadrature: SheetQuadrature, reference: Nodes
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Corners (3, m), weights (3, m), inward direction along two edges (2, m) and share of area (m,)."""
    weights = quadrature.weights(len(reference.x))
    corners = np.asarray(weights.indices, np.int64).reshape(-1, 3)
    placed = quadrature.place(reference)
    a, b, c = (reference.x[corners[:, k]] for k in range(3))
    e1, e2 = b - a, c - a
    g11, g12, g22 = (np.einsum("ej,ej->e", p, q) for p, q in ((e1, e1), (e1, e2), (e2, e2)))
    b1, b2 = (np.einsum("ej,ej->e", placed.inward, e) for e in (e1, e2))
    determinant = g11 * g22 - g12 * g12
    inward = np.stack([(g22 * b1 - g12 * b2) / determinant, (g11 * b2 - g12 * b1) / determinant])
    share = placed.area / (0.5 * np.linalg.norm(np.cross(e1, e2), axis=1))
    return corners.T, weights.data.reshape(-1, 3).T, inward, share


@cuda.jit(cache=True)
def _place(
    nodes,
    node_normal,
    corners,
    weights,
    inward,
    share,
    of_panel,
    flat,
    gravity,
    low,
    size,
    cell,
    integers,
    placed,
    key,
):
    e = cuda.grid(1)
    if e >= placed.shape[1]:
        return
    a, b, c = corners[0, e], corners[1, e], corners[2, e]
    wa, wb, wc = weights[0, e], weights[1, e], weights[2, e]
    for q in range(6):
        placed[q, e] = wa * nodes[q, a] + wb * nodes[q, b] + wc * nodes[q, c]
    for q in range(3):
        placed[PLACED_N + q, e] = wa * node_normal[q, a] + wb * node_normal[q, b] + wc * node_normal[q, c]
        placed[PLACED_INWARD + q, e] = inward[0, e] * (nodes[q, b] - nodes[q, a]) + inward[1, e] * (
            nodes[q, c] - nodes[q, a]
        )
    if flat:
        placed[PLACED_X + 1, e] = 0.0
        placed[PLACED_V + 1, e] = 0.0
        placed[PLACED_N + 1, e] = 0.0
        placed[PLACED_INWARD + 1, e] = 0.0
    _normalise(placed, PLACED_N, e, 0.0)
    _normalise(placed, PLACED_INWARD, e, 1e-30)
    along = gravity * placed[PLACED_N + 2, e]
    for q in range(3):
        if q != 1 or not flat:
            value = wa * nodes[6 + q, a] + wb * nodes[6 + q, b] + wc * nodes[6 + q, c]
            along += value * placed[PLACED_N + q, e]
    placed[PLACED_ALONG, e] = along
    ax, ay, az = nodes[0, b] - nodes[0, a], nodes[1, b] - nodes[1, a], nodes[2, b] - nodes[2, a]
    bx, by, bz = nodes[0, c] - nodes[0, a], nodes[1, c] - nodes[1, a], nodes[2, c] - nodes[2, a]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    placed[PLACED_AREA, e] = share[e] * 0.5 * math.sqrt(nx * nx + ny * ny + nz * nz)
    placed[0, e] = around(placed[0, e], low[0], size[0])
    if integers[3] == 0:
        placed[1, e] = around(placed[1, e], low[1], size[1])
    placed[2, e] = around(placed[2, e], low[2], size[2])
    cells = integers[0] * integers[1] * integers[2]
    number = cell_number(placed[0, e], placed[1, e], placed[2, e], low, cell, integers)
    key[e] = of_panel[e] * cells + number


@cuda.jit(device=True)
def _normalise(rows, first, e, least):
    x, y, z = rows[first, e], rows[first + 1, e], rows[first + 2, e]
    length = max(math.sqrt(x * x + y * y + z * z), least)
    rows[first, e] = x / length
    rows[first + 1, e] = y / length
    rows[first + 2, e] = z / length


@cuda.jit(cache=True)
def _pack_elements(placed, key, order, cells, low, cell, integers, rows, column, cell_of, panel):
    j = cuda.grid(1)
    if j >= order.shape[0]:
        return
    e = order[j]
    p = key[e] // cells
    c = key[e] - p * cells
    cx, cy, cz = place_of(c, integers)
    rows[0, j] = placed[0, e] - low[0] - (cx + 0.5) * cell[0]
    rows[1, j] = placed[1, e] - low[1] - (cy + 0.5) * cell[1]
    rows[2, j] = placed[2, e] - low[2] - (cz + 0.5) * cell[2]
    for q in range(3):
        rows[3 + q, j] = placed[PLACED_V + q, e]
        rows[6 + q, j] = placed[PLACED_N + q, e]
    rows[9, j] = placed[PLACED_ALONG, e]
    rows[10, j] = placed[PLACED_AREA, e]
    column[j] = cx
    cell_of[j] = c
    panel[j] = p


@cuda.jit(cache=True)
def _pick(picked, values, out):
    i = cuda.grid(1)
    if i < picked.shape[0]:
        out[i] = values[picked[i]]


@cuda.jit(cache=True)
def _pack_probes(placed, probe, depth, key, order, cells, low, cell, integers, rows, column):
    j = cuda.grid(1)
    if j >= order.shape[0]:
        return
    k = order[j]
    e = probe[k]
    cx, cy, cz = place_of(key[k] % cells, integers)
    rows[0, j] = placed[0, e] - low[0] - (cx + 0.5) * cell[0]
    rows[1, j] = placed[1, e] - low[1] - (cy + 0.5) * cell[1]
    rows[2, j] = placed[2, e] - low[2] - (cz + 0.5) * cell[2]
    for q in range(3):
        rows[3 + q, j] = placed[PLACED_N + q, e]
        rows[6 + q, j] = placed[PLACED_INWARD + q, e]
    rows[9, j] = depth[k]
    column[j] = cx
