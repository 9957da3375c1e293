# SPDX-License-Identifier: Apache-2.0
"""Which neighbours walls hide, against the definition entry by entry."""

import numpy as np
import pytest

from cwmav_sim.sph.gather import REACH, SLABS
from cwmav_sim.sph.visibility import count_sides, hide

CHANNELS, ROOM = 3, 512
BEGIN = np.linspace(0, 480, SLABS + 1).astype(np.int64)  # 24 entries a slab


@pytest.fixture
def sides():
    """Distances of which one channel has zeros only and another one a side only."""
    draw = np.random.default_rng(1)
    signed = draw.normal(size=(CHANNELS, ROOM)).astype(np.float32)
    signed[1] = 0.0
    signed[2] = np.abs(signed[2])
    return signed, draw.normal(size=(CHANNELS, ROOM)).astype(np.float32)


def counted(signed):
    below, above = (np.full((CHANNELS, SLABS + 1), -1, np.int32) for _ in range(2))
    count_sides(signed, BEGIN, SLABS, np.ones(CHANNELS, np.bool_), below, above)
    return below, above


def test_only_wanted_channels_are_counted(sides):
    below, above = (np.full((CHANNELS, SLABS + 1), -1, np.int32) for _ in range(2))
    count_sides(sides[0], BEGIN, SLABS, np.array([True, False, True]), below, above)
    every_below, every_above = counted(sides[0])
    assert (below[1] == -1).all()
    assert (above[1] == -1).all()
    assert (below[::2] == every_below[::2]).all()
    assert (above[::2] == every_above[::2]).all()


def test_counts_run_on_from_slab_to_slab(sides):
    signed, _ = sides
    below, above = counted(signed)
    for slab in range(SLABS + 1):
        assert (below[:, slab] == (signed[:, : BEGIN[slab]] < 0).sum(axis=1)).all()
        assert (above[:, slab] == (signed[:, : BEGIN[slab]] > 0).sum(axis=1)).all()


@pytest.mark.parametrize("own", [(0.3, 0.2, 0.1), (-0.3, 0.0, -0.4), (-0.3, 0.1, -0.4), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("slab", [0, 5])
def test_hidden_is_what_a_wall_stands_before(sides, own, slab):
    signed, inside = sides
    s_a, d_a = np.array(own, np.float32), np.array((0.1, 0.2, -0.3), np.float32)
    weight, out = np.arange(1, ROOM + 1, dtype=np.float32), np.zeros(ROOM, np.float32)
    first, n = int(BEGIN[slab]), int(BEGIN[slab + 2 * REACH + 1] - BEGIN[slab])
    seen = hide(weight, s_a, d_a, signed, inside, *counted(signed), slab, first, n, out)
    window = slice(first, first + n)
    across = s_a[:, None] * signed[:, window] < 0
    through = d_a[:, None] * abs(signed[:, window]) + inside[:, window] * abs(s_a)[:, None] > 0
    hidden = (across & through).any(axis=0)
    assert (seen[window] == np.where(hidden, 0.0, weight[window])).all()
    if own == (0.3, 0.2, 0.1):
        assert 0 < hidden.sum() < n
    if own == (0.0, 0.0, 0.0):
        assert seen is weight or np.shares_memory(seen, weight)
