# SPDX-License-Identifier: Apache-2.0
"""Points on walls in panel and cell order, against the sort of particles."""

import numpy as np
import pytest

from cwmav_sim.sph.cells import make_grid, sort_into_cells
from cwmav_sim.sph.packing import pack_points


@pytest.mark.parametrize("mirrored", [True, False])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_points_are_packed_panel_by_panel_in_cell_order(mirrored, kind):
    draw = np.random.default_rng(9)
    low, size = np.array([-0.2, 0.0, -0.5]), np.array([0.7, 0.8, 0.9])
    grid = make_grid(low, size, 0.1, mirrored=mirrored, dimensions=3)
    x = low + size * draw.random((300, 3))
    x[::7, 0] += size[0]  # beyond a periodic face
    x[3::7, 2] -= size[2]
    if not mirrored:
        x[5::7, 1] += size[1]
    panel = draw.integers(0, 3, 300)
    chosen = np.sort(draw.permutation(300)[:200])
    vector, scalar = draw.normal(size=(300, 3)), draw.normal(size=300)
    packed = pack_points(x, panel, chosen, (vector,), (scalar,), 3, grid, np.dtype(kind))
    first = 0
    for p in range(3):
        mine = np.flatnonzero(panel[chosen] == p)
        inside = x[chosen[mine]].copy()
        grid.wrap(inside)
        sorting = sort_into_cells(inside, grid)
        last = first + len(mine)
        assert (packed.start[p] == first + sorting.start).all()
        assert (packed.number[first:last] == mine[sorting.order]).all()
        assert (packed.column[first:last] == sorting.column).all()
        own = chosen[mine[sorting.order]]
        expected = np.vstack([sorting.local.T, vector[own].T, scalar[own]]).astype(kind)
        assert (packed.rows[:, first:last] == expected).all()
        first = last
    assert first == 200
