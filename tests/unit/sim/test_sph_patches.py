# SPDX-License-Identifier: Apache-2.0
"""How cells are grouped and dealt, and that a cell finds around it what a search through all points finds."""

import numpy as np
import pytest

from cwmav_sim.sph.blocks import BLOCK
from cwmav_sim.sph.cells import REACH, make_grid, sort_into_cells
from cwmav_sim.sph.gather import ANY_IMAGE, PADDING, buffer_room, fill, piece, slab_space
from cwmav_sim.sph.patches import (
    CHUNKS,
    HEIGHT,
    ROWS,
    SLABS,
    WIDTH,
    cell_of,
    cells_in,
    centre_of,
    dealt,
    marked_slabs,
    patch_of,
    share,
)

UNIT = np.ones(3)


def every_patch(integers):
    numbers = [dealt(integers, chunk, turn) for chunk in range(CHUNKS) for turn in range(share(integers))]
    return [patch_of(integers, number) for number in numbers if number >= 0]


@pytest.mark.parametrize(
    "shape", [(7, 1, 40), (7, WIDTH, HEIGHT), (9, WIDTH + 1, HEIGHT + 1), (42, 21, 32), (6, 4, 6)]
)
def test_every_cell_is_dealt_once(shape):
    integers = np.array([*shape, 1, REACH])
    cells = [
        cell_of(p, member, integers, UNIT)[0] for p in every_patch(integers) for member in range(cells_in(p))
    ]
    assert sorted(cells) == list(range(shape[0] * shape[1] * shape[2]))


def test_offsets_lead_from_the_centre_to_the_cell():
    integers = np.array([7, 9, 20, 1, REACH])
    cell = np.array([0.1, 0.2, 0.3])
    for patch in every_patch(integers):
        y, z = centre_of(patch)
        for member in range(cells_in(patch)):
            number, (slab, row), offset = cell_of(patch, member, integers, cell)
            at = np.array([number // 7 % 9, number // 63])
            np.testing.assert_allclose(offset, (at - [y, z]) * cell[1:], atol=1e-12)
            assert (row, slab) == (at[0] - patch.y0, at[1] - patch.z0)


@pytest.mark.parametrize(("mirrored", "dimensions"), [(True, 3), (False, 3), (False, 2)])
def test_a_cell_finds_what_a_search_through_all_finds(mirrored, dimensions):
    draw, h = np.random.default_rng(8), 0.1
    size = np.array([0.75, 0.85, 2.2]) if dimensions == 3 else np.array([0.75, 0.02, 2.2])
    low = np.array([-0.3, 0.0, 0.1])
    grid = make_grid(low, size, h, mirrored=mirrored, dimensions=dimensions)
    x = low + size * draw.random((700, 3))
    if dimensions == 2:
        x[:, 1] = low[1] + 0.5 * size[1]
    sorting = sort_into_cells(x, grid)
    points = np.ascontiguousarray(sorting.local.T), sorting.column.astype(float), sorting.start
    room = buffer_room(sorting.start, grid.integers)
    begin, runs = slab_space()
    buf = np.zeros((3, room))
    images = [x + size * (i, 0, k) for i in (-1, 0, 1) for k in (-1, 0, 1)]
    if dimensions == 3:
        beside = [v * [1, -1, 1] + [0, 2 * (low[1] + s * size[1]), 0] for v in images for s in (0, 1)]
        shifted = [v + size * (0, s, 0) for v in images for s in (-1, 1)]
        images += beside if mirrored else shifted
    everywhere = np.concatenate(images)
    looked_at = 0
    for patch in every_patch(grid.integers):
        entries = fill(points, (1, 0), ANY_IMAGE, grid.integers, grid.cell, patch, runs, buf, begin)
        assert entries + PADDING + BLOCK <= room
        y, z = centre_of(patch)
        centre = low + (np.array([patch.x, y, z]) + 0.5) * grid.cell
        for member in range(cells_in(patch)):
            number, (slab, row), offset = cell_of(patch, member, grid.integers, grid.cell)
            window = [piece(begin, patch, s, row) for s in range(slab, slab + 2 * REACH + 1)]
            found = np.concatenate([buf[:, a:b] for a, b in window], axis=1).T + centre
            reach = (np.array([REACH, REACH if dimensions == 3 else 0, REACH]) + 0.5) * grid.cell
            middle = centre + np.array([0.0, *offset])
            expected = everywhere[(np.abs(everywhere - middle) < reach).all(axis=1)]
            assert len(found) == len(expected)
            key = [tuple(np.round(point, 9)) for point in found]
            assert sorted(key) == sorted(tuple(np.round(point, 9)) for point in expected)
            looked_at += sorting.start[number + 1] > sorting.start[number]
    assert looked_at > 100


@pytest.mark.parametrize("mirrored", [0, 1])
@pytest.mark.parametrize("nz", [5, 9, 30])
def test_room_holds_the_fullest_surroundings(mirrored, nz):
    nx, ny = 7, 8
    integers = np.array([nx, ny, nz, mirrored, REACH])
    count = np.random.default_rng(6).integers(0, 5, (2, nz, ny, nx))
    start = np.zeros((2, nz * ny * nx + 1), np.int64)
    start[:, 1:] = count.reshape(2, -1).cumsum(axis=1)
    total = int(start[0, -1])
    points = np.zeros((3, total), np.float32), np.zeros(total, np.float32), start[0]
    room = buffer_room(start[0], integers)
    buf, (begin, runs) = np.zeros((3, room + 1000), np.float32), slab_space()
    most = max(
        fill(points, (1, 0), ANY_IMAGE, integers, np.ones(3, np.float32), patch, runs, buf, begin)
        for patch in every_patch(integers)
    )
    assert most + PADDING + BLOCK <= room <= 3 * most + 1024
    assert buffer_room(start, integers) >= room
    # Rows lie apart in the cache: a whole number of pages and three lines.
    assert 4 * room % 4096 == 192


def test_marked_slabs_are_those_around_the_marked_cells():
    integers = np.array([7, WIDTH, HEIGHT, 1, REACH])
    marked = np.zeros(7 * WIDTH * HEIGHT, np.bool_)
    patch = next(p for p in every_patch(integers) if p.x == 3)
    first, last = marked_slabs(marked, integers, patch)
    assert first == last
    for z in (4, 6):
        marked[(z * WIDTH + WIDTH - 1) * 7 + 3] = True
    assert marked_slabs(marked, integers, patch) == (4, 6 + 2 * REACH + 1)
    assert slab_space()[0].shape == (SLABS * ROWS + 1,)
