# SPDX-License-Identifier: Apache-2.0
"""Walls among the particles at one instant: sorted elements, and who is how far from which wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cwmav_sim.sph import visibility
from cwmav_sim.sph.cells import Grid, sort_into_cells
from cwmav_sim.sph.gather import buffer_room
from cwmav_sim.sph.sheet import Elements, SheetQuadrature

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class PackedPoints:
    """Points on all walls in panel and cell order, in the precision of the pairs.

    Attributes
    ----------
    rows : ndarray, shape (k, m)
        Position relative to the centre of the own cell, then further values.
    column : ndarray, shape (m,)
        x index of the cell of each point.
    start : ndarray, shape (panels, cells + 1)
        First place of every cell, panel by panel.
    number : ndarray, shape (m,)
        Number of the point at every place.
    """

    rows: NDArray
    column: NDArray
    start: IntArray
    number: IntArray


@dataclass(frozen=True)
class Sides:
    """Where points lie with respect to every wall; channels beyond the panels are mirror images.

    Attributes
    ----------
    signed : ndarray, shape (channels, n)
        Signed distance from the wall [m]; zero where it is out of reach.
    inside : ndarray, shape (channels, n)
        Distance inside the outline [m]; negative beyond the edge.
    normal : ndarray, shape (channels, 3, n)
        Unit normal at the nearest probe.
    """

    signed: NDArray
    inside: NDArray
    normal: NDArray

    @classmethod
    def empty(cls, channels: int, count: int, dtype: np.dtype) -> Sides:
        """Return room for ``count`` points."""
        shape = (channels, count)
        return cls(np.zeros(shape, dtype), np.zeros(shape, dtype), np.zeros((channels, 3, count), dtype))

    def in_storage_order(self, panels: int, order: IntArray) -> Sides:
        """Return the sides of the walls themselves, put from cell order under the numbers ``order``."""
        out = Sides.empty(panels, len(order), self.signed.dtype)
        out.signed[:, order] = self.signed[:panels]
        out.inside[:, order] = self.inside[:panels]
        out.normal[:, :, order] = self.normal[:panels]
        return out

    def take(self, places: IntArray) -> Sides:
        """Return the points in another order."""
        return Sides(self.signed[:, places], self.inside[:, places], self.normal[:, :, places])


@dataclass(frozen=True)
class Surfaces:
    """Everything a pass needs to know of the walls.

    Attributes
    ----------
    elements : PackedPoints
        Wall elements.
    element_sides : Sides
        Where the elements lie with respect to the other walls.
    near : ndarray, shape (cells,), bool
        Cells that have elements around them.
    particle_sides : Sides
        Where the particles lie, in cell order.
    """

    elements: PackedPoints
    element_sides: Sides
    near: NDArray[np.bool_]
    particle_sides: Sides


def locate_surfaces(
    quadrature: SheetQuadrature,
    placed: Elements,
    grid: Grid,
    fluid: NDArray,
    column: NDArray,
    start: IntArray,
) -> Surfaces:
    """Sort the walls into cells and find the sides of the particles and of the elements.

    Parameters
    ----------
    quadrature, placed : SheetQuadrature, Elements
        The walls and their elements at this instant.
    grid : Grid
        Cells.
    fluid, column, start : ndarray
        Packed particles in cell order, their columns and first places.
    """
    dtype = fluid.dtype
    panels = quadrature.panels
    channels = panels * (2 if grid.mirrored else 1)
    values = (placed.v, placed.normal, placed.normal_acceleration, placed.area)
    elements = _pack(placed.x, quadrature.panel, values, panels, grid, dtype)
    probe = quadrature.probe
    values = (placed.normal[probe], placed.inward[probe], quadrature.depth[probe])  # type: ignore[assignment]
    probes = _pack(placed.x[probe], quadrature.panel[probe], values, panels, grid, dtype)
    near = np.empty(grid.cells, np.bool_)
    visibility.mark_near(elements.start, grid.integers, near)
    cell = grid.cell.astype(dtype)
    room = buffer_room(probes.start, grid.integers)

    def locate(points: NDArray, columns: NDArray, first: IntArray, own: int, sides: Sides) -> None:
        visibility.locate(
            points,
            columns,
            first,
            own,
            probes.rows,
            probes.column,
            probes.start,
            room,
            grid.integers,
            cell,
            near,
            sides.signed,
            sides.inside,
            sides.normal,
        )

    particle_sides = Sides.empty(channels, fluid.shape[1], dtype)
    locate(fluid, column, start, -1, particle_sides)
    element_sides = Sides.empty(channels, elements.rows.shape[1], dtype)
    for panel in range(panels):
        locate(elements.rows, elements.column, elements.start[panel], panel, element_sides)
    return Surfaces(elements, element_sides, near, particle_sides)


def _pack(
    x: FloatArray,
    panel: IntArray,
    values: tuple[FloatArray, ...],
    panels: int,
    grid: Grid,
    dtype: np.dtype,
) -> PackedPoints:
    rows, column, start, number = [], [], [], []
    offset = 0
    for p in range(panels):
        mine = np.flatnonzero(panel == p)
        points = np.ascontiguousarray(x[mine])
        grid.wrap(points)
        sorting = sort_into_cells(points, grid)
        order = mine[sorting.order]
        rows.append(np.vstack([sorting.local.T, *(np.atleast_2d(value[order].T) for value in values)]))
        column.append(sorting.column)
        start.append(sorting.start + offset)
        number.append(order)
        offset += len(mine)
    packed = np.ascontiguousarray(np.hstack(rows), dtype=dtype)
    return PackedPoints(packed, np.concatenate(column).astype(dtype), np.array(start), np.concatenate(number))
