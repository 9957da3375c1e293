# SPDX-License-Identifier: Apache-2.0
"""Which neighbours walls hide, against the definition entry by entry."""

import numpy as np
import pytest

from cwmav_sim.sph.visibility import count_sides, hide

CHANNELS, ROOM, USED = 3, 512, 208


@pytest.fixture
def sides():
    """Distances of which one channel has zeros only and another one a side only."""
    draw = np.random.default_rng(1)
    signed = draw.normal(size=(CHANNELS, ROOM)).astype(np.float32)
    signed[1] = 0.0
    signed[2] = np.abs(signed[2])
    return signed, draw.normal(size=(CHANNELS, ROOM)).astype(np.float32)


def counted(signed):
    below, above = np.full(CHANNELS, -1, np.int32), np.full(CHANNELS, -1, np.int32)
    count_sides(signed, USED, np.ones(CHANNELS, np.bool_), below, above)
    return below, above


def test_only_wanted_channels_are_counted(sides):
    below, above = np.full(CHANNELS, -1, np.int32), np.full(CHANNELS, -1, np.int32)
    count_sides(sides[0], USED, np.array([True, False, True]), below, above)
    every_below, every_above = counted(sides[0])
    assert below[1] == above[1] == -1
    assert (below[::2] == every_below[::2]).all()
    assert (above[::2] == every_above[::2]).all()


def test_counts_are_of_the_entries_in_use(sides):
    signed, _ = sides
    below, above = counted(signed)
    assert (below == (signed[:, :USED] < 0).sum(axis=1)).all()
    assert (above == (signed[:, :USED] > 0).sum(axis=1)).all()


@pytest.mark.parametrize("own", [(0.3, 0.2, 0.1), (-0.3, 0.0, -0.4), (-0.3, 0.1, -0.4), (0.0, 0.0, 0.0)])
def test_hidden_is_what_a_wall_stands_before(sides, own):
    signed, inside = sides
    s_a, d_a = np.array(own, np.float32), np.array((0.1, 0.2, -0.3), np.float32)
    weight, out = np.arange(1, ROOM + 1, dtype=np.float32), np.zeros(ROOM, np.float32)
    seen = hide(weight, s_a, d_a, signed, inside, *counted(signed), USED, out)
    across = s_a[:, None] * signed[:, :USED] < 0
    through = d_a[:, None] * abs(signed[:, :USED]) + inside[:, :USED] * abs(s_a)[:, None] > 0
    hidden = (across & through).any(axis=0)
    assert (seen[:USED] == np.where(hidden, 0.0, weight[:USED])).all()
    assert (seen is weight) == (not across.any())
