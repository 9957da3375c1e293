# SPDX-License-Identifier: Apache-2.0
"""Which particles have walls around them, and how they and the elements lie to every wall."""

from __future__ import annotations

import numpy as np
from numba import cuda

from cwmav_sim.cuda.cells import (
    CELL_X,
    CELL_Y,
    CELL_Z,
    COLUMNS,
    MINUS_TWO,
    NX,
    ONE,
    REACH_Y,
    ZERO,
    CardGrid,
    CellSort,
    place_of,
)
from cwmav_sim.cuda.elements import CardElements
from cwmav_sim.cuda.launch import CardArray, clear, empty, launch, zeros
from cwmav_sim.cuda.rows import REACH, laps, layer, row, run
from cwmav_sim.cuda.scan import Scan
from cwmav_sim.cuda.vector import four
from cwmav_sim.sph.surfaces import ON_WALL

OWN_ROWS = 5  # signed distance, distance inside the outline, normal


class Nearness:
    """The particles near walls, and the sides of particles and elements.

    Parameters
    ----------
    count, elements : int
        Number of particles and of elements.
    panels : int
        Number of walls.
    grid : CardGrid
        Cells.
    dtype : numpy.dtype
        Precision of the pairs.

    Attributes
    ----------
    before : array, shape (cells + 1,), int32
        Particles near walls in the cells before each; the last is their number.
    listed : array, shape (n,), int32
        Their places.
    signed, inside : array, shape (channels, n)
        Distances of the particles in cell order [m]; channels beyond the panels are mirror images.
    element_signed, element_inside : array, shape (channels, m)
        The same of the elements.
    """

    def __init__(self, count: int, elements: int, panels: int, grid: CardGrid, dtype: np.dtype) -> None:
        channels = panels * (2 if grid.integers[3] else 1)
        self._grid = grid
        self.before = zeros(grid.cells + 1, np.int32)
        self.listed = empty(count if panels else 1, np.int32)
        self.signed, self.inside = (zeros((channels, count if panels else 1), dtype) for _ in range(2))
        self.element_signed, self.element_inside = (zeros((channels, elements), dtype) for _ in range(2))
        self._marks = empty(grid.cells, np.int32)
        self._scan = Scan(grid.cells)

    def find(
        self,
        places: CardArray,
        cell_of: CardArray,
        sort: CellSort,
        walls: CardElements,
        own: CardArray,
    ) -> None:
        """Fill everything in for particles in cell order and placed elements.

        ``own``, shape (panels, 5, n), receives the sides of the particles to the walls themselves under
        their numbers.
        """
        grid = self._grid
        clear(self._marks)
        launch(_mark, walls.count, walls.cell_of, grid.integers, self._marks)
        launch(_count_near, grid.cells, sort.start, self._marks)
        self._scan(self._marks, self.before)
        launch(_list_near, grid.cells, sort.start, self.before, self.listed)
        for array in (self.signed, self.inside, own):
            clear(array)
        search = (
            walls.probes,
            walls.probe_column,
            walls.probe_sort.start,
            grid.integers,
            grid.reach,
            grid.cells,
        )
        launch(
            _locate_particles,
            places.shape[0],
            places,
            cell_of,
            sort.order,
            self.before,
            self.listed,
            *search,
            self.signed,
            self.inside,
            own,
        )
        launch(
            _locate_elements,
            walls.count,
            walls.rows,
            walls.column,
            walls.cell_of,
            walls.panel,
            walls.panels,
            *search,
            ON_WALL * grid.cell[0],
            self.element_signed,
            self.element_inside,
        )


@cuda.jit(cache=True)
def _mark(cell_of, integers, marks):
    """Mark the cells within reach of every element; all write the same value."""
    e = cuda.grid(1)
    if e >= cell_of.shape[0]:
        return
    cx, cy, cz = place_of(cell_of[e], integers)
    nx, reach_y = integers[NX], integers[REACH_Y]
    for dz in range(-REACH, REACH + 1):
        first_row = layer(integers, cz, dz)
        for dy in range(-reach_y, reach_y + 1):
            base, _ = row(integers, first_row, cy, dy)
            for dx in range(-REACH, REACH + 1):
                marks[base + (cx + dx + nx) % nx] = 1


@cuda.jit(cache=True)
def _count_near(start, marks):
    c = cuda.grid(1)
    if c < marks.shape[0]:
        marks[c] = start[c + 1] - start[c] if marks[c] > 0 else 0


@cuda.jit(cache=True)
def _list_near(start, before, listed):
    c = cuda.grid(1)
    if c + 1 < start.shape[0]:
        for q in range(before[c + 1] - before[c]):
            listed[before[c] + q] = start[c] + q


@cuda.jit(device=True, fastmath=True)
def _nearest(at, cell_place, base_cell, image, probes, probe_column, start, integers, reach):
    """Return the vector from the nearest probe around a point, its place or -1, and its sign.

    ``image`` 1 takes the probes themselves, -1 their mirror images.
    """
    x, y, z, own_column = at
    cx, cy, cz = cell_place
    nx, reach_y = integers[NX], integers[REACH_Y]
    zero, one = reach[ZERO], reach[ONE]
    best_x = best_y = best_z = best_sign = zero
    best = reach[CELL_X] * reach[COLUMNS] * reach[COLUMNS] + one
    found = np.int32(-1)
    first_lap, last_lap = laps(nx, cx - REACH, cx + REACH)
    first_column = own_column + reach[COLUMNS] if first_lap < 0 else own_column
    shift_z = reach[MINUS_TWO]
    for dz in range(-REACH, REACH + 1):
        first_row = layer(integers, cz, dz)
        shift_y = reach[MINUS_TWO] if reach_y > 0 else zero
        for dy in range(-reach_y, reach_y + 1):
            base, side = row(integers, first_row, cy, dy)
            if side == image:
                sign = one if side > 0 else -one
                column = first_column
                for lap in range(first_lap, last_lap + 1):
                    first, last = run(start, base_cell + base, nx, cx - REACH, cx + REACH, lap)
                    for j in range(first, last):
                        dx = x - probes[0, j] + (column - probe_column[j]) * reach[CELL_X]
                        dy_ = y - shift_y * reach[CELL_Y] - sign * probes[1, j]
                        dz_ = z - shift_z * reach[CELL_Z] - probes[2, j]
                        r2 = dx * dx + dy_ * dy_ + dz_ * dz_
                        if r2 < best:
                            best, best_x, best_y, best_z, best_sign = r2, dx, dy_, dz_, sign
                            found = np.int32(j)
                    column -= reach[COLUMNS]
            shift_y += one
        shift_z += one
    return best_x, best_y, best_z, found, best_sign


@cuda.jit(device=True, fastmath=True)
def _distances(dx, dy, dz, j, sign, probes):
    """Return the distances from the wall and inside its outline, and the normal, by the probe at place j."""
    nx, ny, nz = probes[3, j], sign * probes[4, j], probes[5, j]
    signed = dx * nx + dy * ny + dz * nz
    inside = probes[9, j] + dx * probes[6, j] + dy * sign * probes[7, j] + dz * probes[8, j]
    return signed, inside, nx, ny, nz


@cuda.jit(device=True, fastmath=True)
def _measure(at, cell_place, c, panels, cells, probes, probe_column, start, integers, reach):
    """Return whether wall or image ``c`` is in reach of a point, its distances from it, and the normal."""
    image = 1 if c < panels else -1
    panel = c if c < panels else c - panels
    dx, dy, dz, j, sign = _nearest(
        at, cell_place, panel * cells, image, probes, probe_column, start, integers, reach
    )
    zero = reach[ZERO]
    if j < 0:
        return False, zero, zero, zero, zero, zero
    s, d, nx, ny, nz = _distances(dx, dy, dz, j, sign, probes)
    return True, s, d, nx, ny, nz


@cuda.jit(cache=True, fastmath=True)
def _locate_particles(
    places,
    cell_of,
    order,
    before,
    listed,
    probes,
    probe_column,
    start,
    integers,
    reach,
    cells,
    signed,
    inside,
    own,
):
    t = cuda.grid(1)
    if t >= before[before.shape[0] - 1]:
        return
    i = listed[t]
    at, cell_place = four(places, i), place_of(cell_of[i], integers)
    panels = own.shape[0]
    for c in range(signed.shape[0]):
        there, s, d, nx, ny, nz = _measure(
            at, cell_place, c, panels, cells, probes, probe_column, start, integers, reach
        )
        if there:
            signed[c, i] = s
            inside[c, i] = d
            if c < panels:
                number = order[i]
                own[c, 0, number] = s
                own[c, 1, number] = d
                own[c, 2, number] = nx
                own[c, 3, number] = ny
                own[c, 4, number] = nz


@cuda.jit(cache=True, fastmath=True)
def _locate_elements(
    elements,
    column,
    cell_of,
    of_panel,
    panels,
    probes,
    probe_column,
    start,
    integers,
    reach,
    cells,
    on_wall,
    signed,
    inside,
):
    e = cuda.grid(1)
    if e >= cell_of.shape[0]:
        return
    cell_place = place_of(cell_of[e], integers)
    at = (elements[0, e], elements[1, e], elements[2, e], column[e])
    for c in range(signed.shape[0]):
        if c == of_panel[e]:
            signed[c, e] = 0.0
            inside[c, e] = 0.0
        else:
            _, s, d, _, _, _ = _measure(
                at, cell_place, c, panels, cells, probes, probe_column, start, integers, reach
            )
            signed[c, e] = s if abs(s) >= on_wall else reach[ZERO]
            inside[c, e] = d
