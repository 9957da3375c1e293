# SPDX-License-Identifier: Apache-2.0
"""Factors by blocks in fixed places, and the sum of elements that they are made of."""

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose

from cwmav_sim.wing.arithmetic import HOST
from cwmav_sim.wing.block_lu import BlockLU
from cwmav_sim.wing.sparsity import Pattern, add_all

ROWS = 40


def graph(seed):
    """Return a random symmetric pattern of vectors; the last three hang on nothing."""
    rng = np.random.default_rng(seed)
    near = sp.random(ROWS, ROWS, density=0.06, random_state=rng).toarray() > 0
    near[-3:] = near[:, -3:] = False
    return near | near.T | np.eye(ROWS, dtype=bool)


def matrix(seed):
    """Unsymmetric values in a symmetric pattern of 3 x 3 blocks."""
    rng = np.random.default_rng(seed + 100)
    full = np.kron(graph(seed), np.ones((3, 3))) * rng.normal(size=(3 * ROWS, 3 * ROWS))
    return sp.csc_matrix(full + 12.0 * np.eye(3 * ROWS))


@pytest.mark.parametrize("seed", range(5))
def test_factors_solve_every_matrix_of_the_pattern(seed):
    first = matrix(seed)
    lu = BlockLU(first)
    for factor in (1.0, 3.0):
        a = first.copy()
        a.data = factor * a.data + 0.1 * np.random.default_rng(9).normal(size=a.nnz)
        right = np.random.default_rng(1).normal(size=(ROWS, 3))
        x = lu.factorised(a.data).solve(right)
        assert_allclose(x.ravel(), np.linalg.solve(a.toarray(), right.ravel()), rtol=1e-9, atol=1e-12)


def test_factors_multiply_to_the_matrix_in_the_order_of_elimination():
    a = matrix(2)
    lu = BlockLU(a)
    blocks = lu.factorised(a.data).blocks
    low, up = np.eye(3 * ROWS), np.zeros((3 * ROWS, 3 * ROWS))
    for i in range(ROWS):
        for p in range(lu.starts[i], lu.starts[i + 1]):
            j = lu.columns[p]
            place = np.s_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
            if j < i:
                low[place] = blocks[p]
            elif j > i:
                up[place] = blocks[p]
            else:
                low[place] += np.tril(blocks[p], -1)
                up[place] = np.triu(blocks[p])
    order = (3 * lu.order[:, None] + np.arange(3)).ravel()
    assert_allclose(low @ up, a.toarray()[np.ix_(order, order)], atol=1e-12)


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_pivot_that_vanishes_or_is_no_number_is_an_error(value):
    a = matrix(0)
    a[3 * ROWS - 1, 3 * ROWS - 3 :] = value
    with pytest.raises(RuntimeError, match="singular"):
        BlockLU(a).factorised(a.data)


def test_held_rows_drop_out_of_the_sum_of_elements():
    rng = np.random.default_rng(4)
    pairs = np.array([[0, 1], [1, 2], [3, 1]])
    dofs = (3 * pairs[:, :, None] + np.arange(3)).reshape(3, 6)
    single = np.arange(12).reshape(4, 3)
    values = rng.normal(size=(3, 6, 6)), rng.normal(size=(4, 3, 3))
    full = np.zeros((12, 12))
    for family, blocks in zip((dofs, single), values, strict=True):
        for at, block in zip(family, blocks, strict=True):
            full[np.ix_(at, at)] += block
    free = np.array([0, 1, 3])
    kept = (3 * free[:, None] + np.arange(3)).ravel()
    pattern = Pattern([dofs, single], 4, free)
    stored = np.zeros(pattern.entries)
    add_all(HOST, pattern.gatherings, values, stored)
    a = pattern.matrix(stored)
    assert_allclose(a.toarray(), full[np.ix_(kept, kept)])
    right = rng.normal(size=(3, 3))
    solved = pattern.lu.factorised(a.data).solve(right).ravel()
    assert_allclose(a @ solved, right.ravel(), atol=1e-9)
