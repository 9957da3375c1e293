# SPDX-License-Identifier: Apache-2.0
"""What is kept of the surroundings of a cell, against a search through all entries."""

import llvmlite.binding as llvm
import numba as nb
import numpy as np
import pytest

from cwmav_sim.sph import blocks
from cwmav_sim.sph.blocks import lane_orders, lanes
from cwmav_sim.sph.gather import (
    ANY_IMAGE,
    CHUNKS,
    FAR,
    REACH,
    SLABS,
    STRETCH,
    buffer_room,
    dealt,
    fill,
    share,
    slab_space,
    stretch,
)
from cwmav_sim.sph.nearby import MULTIPLE, add_back, box_around, keep_nearby, keep_same

ROWS, ENTRIES, ROOM = 5, 203, 304


@nb.njit
def keep(buf, begin, box, reach2, orders, out, kept):
    return keep_nearby(buf, ROWS, begin, 0, box, reach2, orders, out, kept)


@nb.njit
def keep_more(buf, row, kept, looks, orders, out):
    keep_same(buf, row, kept, looks, orders, out)


@pytest.fixture(params=[np.float32, np.float64])
def window(request):
    """Return a buffer of which entries 5 to 201 belong to the window, a box and the square of a reach."""
    draw = np.random.default_rng(3)
    buf = np.zeros((ROWS, ROOM), request.param)
    buf[:, :ENTRIES] = draw.uniform(-1.0, 1.0, (ROWS, ENTRIES))
    buf[0, ENTRIES:] = FAR
    begin = np.full(SLABS + 1, 5, np.int64)
    begin[2 * REACH + 1 :] = ENTRIES - 1
    buf[0, :5] = buf[0, ENTRIES - 1 :] = FAR  # other slabs lie out of reach
    kind = request.param
    box = (kind(0.1), kind(-0.2), kind(0.3)), (kind(0.2), kind(0.05), kind(0.1))
    return buf, begin, box, kind(0.5)


def within(buf, box, reach2):
    beyond = np.maximum(np.abs(buf[:3] - np.array(box[0])[:, None]) - np.array(box[1])[:, None], 0.0)
    return np.flatnonzero((beyond**2).sum(axis=0) < reach2)


def kept_of(buf, begin, box, reach2, function=keep):
    out, kept = np.full((ROWS, ROOM), np.nan, buf.dtype), np.zeros((ROOM, 2), np.uint64)
    n, looks = function(buf, begin, box, reach2, lane_orders(buf.dtype), out, kept)
    return out, kept, n, looks


def test_exactly_what_is_within_reach_is_kept_in_its_order(window):
    buf, _, box, reach2 = window
    out, _, n, _ = kept_of(*window)
    expected = within(buf, box, reach2)
    assert 20 < len(expected) < ENTRIES - 20
    assert (out[:, : len(expected)] == buf[:, expected]).all()
    assert n % MULTIPLE == 0
    assert len(expected) <= n < len(expected) + MULTIPLE
    assert (out[0, len(expected) : n] == FAR).all()
    assert (out[1:, len(expected) : n] == 0.0).all()


def test_other_buffers_follow_and_sums_go_back(window):
    buf, _, box, reach2 = window
    _, kept, _, looks = kept_of(*window)
    expected = within(buf, box, reach2)
    other = np.random.default_rng(4).normal(size=(3, ROOM)).astype(buf.dtype)
    out = np.full((3, ROOM), np.nan, buf.dtype)
    keep_more(other, 1, kept, looks, lane_orders(buf.dtype), out)
    assert (out[1, : len(expected)] == other[1, expected]).all()
    assert (out[1, len(expected) : len(expected) + MULTIPLE] == 0.0).all()
    back = other.copy()
    add_back(np.ascontiguousarray(out[1:2]), kept, looks, back[1:2])
    other[1, expected] *= 2.0
    assert (back == other).all()


def test_a_processor_without_the_permutation_keeps_the_same(window, monkeypatch):
    assert blocks.has_permutation() == bool(llvm.get_host_cpu_features().get("avx2", False))
    monkeypatch.setattr(blocks, "has_permutation", lambda: False)

    @nb.njit
    def plain(buf, begin, box, reach2, orders, out, kept):
        lane = 32 // buf.itemsize
        entries = 0
        for at in range(begin[0] // lane * lane, begin[2 * REACH + 1], lane):
            bits = blocks.lanes_within(buf, at, box[0], box[1], reach2)
            for row in range(ROWS):
                blocks.ordered_lanes(out, entries, buf, at, row, orders[bits])
            entries += blocks.count_lanes(bits)
        return entries, 0

    found, _, entries, _ = kept_of(*window, plain)
    out, *_ = kept_of(*window)
    assert entries > 20
    assert (found[:, :entries] == out[:, :entries]).all()


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_orders_bring_the_marked_lanes_to_the_front(kind):
    count = lanes(np.dtype(kind))
    orders = lane_orders(np.dtype(kind))
    assert len(orders) == 2**count
    values = np.arange(count, dtype=kind).view(np.float32)
    for bits, order in enumerate(orders):
        places = np.array([order], np.uint64).view(np.uint8)
        moved = values[places].view(kind)
        marked = [lane for lane in range(count) if bits >> lane & 1]
        assert moved[: len(marked)].tolist() == marked
        assert sorted(moved) == list(range(count))


def test_box_holds_the_points_of_a_cell():
    points = np.random.default_rng(5).normal(size=(4, 9)).astype(np.float32)
    centre, half = box_around(points, 2, 6, np.float32(0.25))
    low, high = points[:3, 2:6].min(axis=1), points[:3, 2:6].max(axis=1)
    np.testing.assert_allclose(np.array(centre) - [0, 0, 0.25], (low + high) / 2, atol=1e-6)
    np.testing.assert_allclose(half, (high - low) / 2, atol=1e-6)


@pytest.mark.parametrize("mirrored", [0, 1])
@pytest.mark.parametrize("nz", [5, 9, 30])
def test_room_holds_the_fullest_surroundings(mirrored, nz):
    nx, ny = 7, 6
    integers = np.array([nx, ny, nz, mirrored, REACH])
    count = np.random.default_rng(6).integers(0, 5, (2, nz, ny, nx))
    start = np.zeros((2, nz * ny * nx + 1), np.int64)
    start[:, 1:] = count.reshape(2, -1).cumsum(axis=1)
    total = int(start[0, -1])
    points = np.zeros((3, total), np.float32), np.zeros(total, np.float32), start[0]
    room = buffer_room(start[0], integers)
    buf, begin = np.zeros((3, room + 1000), np.float32), np.zeros(SLABS + 1, np.int64)
    (_, runs), most = slab_space(), 0
    for number in range(nx * ny * -(-nz // STRETCH)):
        place = stretch(integers, number)
        fill(points, (1, 0), ANY_IMAGE, integers, np.ones(3, np.float32), place, runs, buf, begin)
        most = max(most, int(begin[place[3] - place[2] + 2 * REACH]))
    assert most + MULTIPLE <= room <= 3 * most
    assert room // MULTIPLE % 2 == 1
    assert buffer_room(start, integers) >= room


def test_every_stretch_is_dealt_once():
    integers = np.array([7, 6, 40, 1, REACH])
    numbers = [dealt(integers, chunk, turn) for chunk in range(CHUNKS) for turn in range(share(integers))]
    dealt_out = [number for number in numbers if number >= 0]
    assert sorted(dealt_out) == list(range(7 * 6 * 3))
