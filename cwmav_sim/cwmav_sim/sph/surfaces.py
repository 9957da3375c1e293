# SPDX-License-Identifier: Apache-2.0
"""Walls among the particles at one instant: sorted elements, and who is how far from which wall."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from cwmav_sim.sph import visibility
from cwmav_sim.sph.cells import Grid
from cwmav_sim.sph.gather import buffer_room
from cwmav_sim.sph.packing import PackedPoints, pack_points
from cwmav_sim.sph.patches import CHUNKS
from cwmav_sim.sph.sheet import Elements, SheetQuadrature

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# An element this close to another wall, in cells, lies on it. A wall that meets the mirror goes on in its
# image: on which side of that its elements lie is chance, and each would be hidden from the air on one side.
ON_WALL = 1e-4


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
        Unit normal at the nearest probe; in cell order undefined where the wall is out of reach.
    """

    signed: NDArray
    inside: NDArray
    normal: NDArray

    @classmethod
    def empty(cls, channels: int, count: int, dtype: np.dtype) -> Sides:
        """Return the sides of ``count`` points out of reach of all walls."""
        shape = (channels, count)
        return cls(np.zeros(shape, dtype), np.zeros(shape, dtype), np.zeros((channels, 3, count), dtype))

    @classmethod
    def unset(cls, channels: int, count: int, dtype: np.dtype) -> Sides:
        """Return room for the sides of ``count`` points, to be filled."""
        shape = (channels, count)
        return cls(np.empty(shape, dtype), np.empty(shape, dtype), np.empty((channels, 3, count), dtype))

    def in_storage_order(
        self, panels: int, order: IntArray, start: IntArray, near: NDArray[np.bool_]
    ) -> Sides:
        """Return the sides of the walls themselves, put from cell order under the numbers ``order``.

        Parameters
        ----------
        panels : int
            Number of walls.
        order, start : ndarray
            Number of the point at every place and first place of every cell.
        near : ndarray, shape (cells,), bool
            Cells that may hold points within reach of a wall.
        """
        out = Sides.unset(panels, len(order), self.signed.dtype)
        _in_storage_order(
            self.signed,
            self.inside,
            self.normal,
            order,
            start,
            np.flatnonzero(near),
            out.signed,
            out.inside,
            out.normal,
        )
        return out

    def take(self, places: IntArray) -> Sides:
        """Return the points in another order, again row by row in memory."""
        return Sides(*(np.take(rows, places, axis=-1) for rows in (self.signed, self.inside, self.normal)))


@dataclass(frozen=True)
class Surfaces:
    """Everything a pass needs to know of the walls.

    Attributes
    ----------
    elements : PackedPoints
        Wall elements.
    element_sides : Sides
        Where the elements lie with respect to the other walls.
    near : ndarray, shape (channels, cells), bool
        Cells that have elements of a wall around them.
    near_any : ndarray, shape (cells,), bool
        The same of all walls.
    particle_sides : Sides
        Where the particles lie, in cell order.
    """

    elements: PackedPoints
    element_sides: Sides
    near: NDArray[np.bool_]
    near_any: NDArray[np.bool_]
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
    elements = pack_points(
        placed.x,
        quadrature.panel,
        quadrature.every,
        (placed.v, placed.normal),
        (placed.normal_acceleration, placed.area),
        panels,
        grid,
        dtype,
    )
    probes = pack_points(
        placed.x,
        quadrature.panel,
        quadrature.probe,
        (placed.normal, placed.inward),
        (quadrature.depth,),
        panels,
        grid,
        dtype,
    )
    near = np.empty((channels, grid.cells), np.bool_)
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

    particle_sides = Sides.unset(channels, fluid.shape[1], dtype)
    locate(fluid, column, start, -1, particle_sides)
    element_sides = Sides.unset(channels, elements.rows.shape[1], dtype)
    for panel in range(panels):
        locate(elements.rows, elements.column, elements.start[panel], panel, element_sides)
    element_sides.signed[np.abs(element_sides.signed) < ON_WALL * grid.cell[0]] = 0.0
    return Surfaces(elements, element_sides, near, np.asarray(near.any(axis=0)), particle_sides)


@nb.njit(cache=True, parallel=True, error_model="numpy")
def _in_storage_order(
    signed: NDArray,
    inside: NDArray,
    normal: NDArray,
    order: IntArray,
    start: IntArray,
    cells: IntArray,
    signed_out: NDArray,
    inside_out: NDArray,
    normal_out: NDArray,
) -> None:
    n = signed_out.shape[1]
    for chunk in nb.prange(CHUNKS):
        visibility.clear(signed_out, 0, n, chunk)
        visibility.clear(inside_out, 0, n, chunk)
        for c in range(signed_out.shape[0]):
            visibility.clear(normal_out[c], 0, n, chunk)
    zero = signed.dtype.type(0.0)
    for number in nb.prange(cells.shape[0]):
        cell = cells[number]
        for j in range(start[cell], start[cell + 1]):
            i = order[j]
            for c in range(signed_out.shape[0]):
                if signed[c, j] == zero and inside[c, j] == zero:
                    continue
                signed_out[c, i], inside_out[c, i] = signed[c, j], inside[c, j]
                for q in range(3):
                    normal_out[c, q, i] = normal[c, q, j]
