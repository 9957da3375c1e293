# SPDX-License-Identifier: Apache-2.0
"""The order of elimination: a permutation that separates, the same every time, with short chains."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from cwmav_sim.wing.block_lu import BlockLU
from cwmav_sim.wing.dissection import elimination_order

WIDE, HIGH = 24, 12


def grid(wide=WIDE, high=HIGH):
    """Return the graph of a grid of quadrilaterals, all corners of each beside each other."""
    line = [sp.diags_array([1.0, 1.0, 1.0], offsets=[-1, 0, 1], shape=(n, n)) for n in (high, wide)]
    return sp.csc_matrix(sp.kron(*line))


def random(seed, size=90):
    rng = np.random.default_rng(seed)
    near = sp.random(size, size, density=0.02, random_state=rng)
    return sp.csc_matrix(near + near.T + sp.identity(size))


GRAPHS = {
    "none": sp.csc_matrix((0, 0)),
    "single": sp.csc_matrix(np.ones((1, 1))),
    "apart": sp.identity(50, format="csc"),
    "full": sp.csc_matrix(np.ones((60, 60))),
    "star": sp.csc_matrix(np.eye(60) + (np.arange(60) == 0) + (np.arange(60) == 0)[:, None]),
    "line": grid(200, 1),
    "grid": grid(),
    "two": sp.block_diag([grid(), grid(9, 9)], format="csc"),
    "random": random(1),
}


@pytest.mark.parametrize("name", GRAPHS)
def test_every_vector_is_eliminated_once_and_in_the_same_order_every_time(name):
    order = elimination_order(GRAPHS[name])
    assert order.dtype == np.int64
    assert np.array_equal(np.sort(order), np.arange(GRAPHS[name].shape[0]))
    assert np.array_equal(order, elimination_order(GRAPHS[name].copy()))


def test_without_the_last_separator_a_grid_falls_into_even_halves():
    graph = grid()
    order = elimination_order(graph)
    kept = order[:-HIGH]
    _, piece = connected_components(graph[kept][:, kept])
    sizes = np.sort(np.bincount(piece))[::-1]
    assert len(sizes) == 2
    assert sizes[0] <= 0.55 * WIDE * HIGH


def test_components_follow_each_other():
    shuffled = np.random.default_rng(0).permutation(60)
    graph = sp.block_diag([grid(6, 5), grid(10, 3)], format="csr")[shuffled][:, shuffled]
    _, component = connected_components(graph)
    found = component[elimination_order(sp.csc_matrix(graph))]
    assert np.count_nonzero(np.diff(found)) == 1


def places(graph):
    """Return the places of the factors of 3 x 3 blocks with this graph."""
    return BlockLU(sp.csc_matrix(sp.kron(graph, np.ones((3, 3)))))


def test_a_line_of_vectors_is_eliminated_from_many_places_at_once():
    lu = places(grid(200, 1))
    height = np.zeros(200, dtype=int)
    for i in range(200):
        before = lu.columns[lu.starts[i] : lu.diagonal[i]]
        height[i] = 1 + height[before].max(initial=0)
    assert height.max() <= 30
    assert len(lu.columns) <= 1.5 * 598


def test_a_grid_fills_less_than_a_band():
    size = 30
    assert len(places(grid(size, size)).columns) < 0.6 * size**2 * (2 * size + 3)
