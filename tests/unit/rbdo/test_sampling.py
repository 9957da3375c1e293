# SPDX-License-Identifier: Apache-2.0
"""Latin hypercube and design space."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cwmav_common.errors import InputError
from cwmav_rbdo.sampling import latin_hypercube
from cwmav_rbdo.space import DesignSpace, Variable


@pytest.mark.parametrize("n", [1, 6, 20])
def test_one_sample_in_each_interval_of_each_variable(n):
    X = latin_hypercube(n, [4, -10, 0], [30, 60, 6], np.random.default_rng(0))
    strata = np.floor((X - [4, -10, 0]) / [26, 70, 6] * n).astype(int)
    assert_allclose(np.sort(strata, axis=0), np.tile(np.arange(n)[:, None], 3))


def test_same_seed_same_samples():
    first = latin_hypercube(20, [0, 0], [1, 2], np.random.default_rng(3))
    assert np.array_equal(first, latin_hypercube(20, [0, 0], [1, 2], np.random.default_rng(3)))
    assert not np.array_equal(first, latin_hypercube(20, [0, 0], [1, 2], np.random.default_rng(4)))


def test_wrong_size_and_bounds_are_refused():
    with pytest.raises(InputError, match="number of samples = 0"):
        latin_hypercube(0, [0], [1], np.random.default_rng(0))
    with pytest.raises(InputError, match=r"variable 1: \[2.0, 1.0\]"):
        latin_hypercube(3, [0, 2], [1, 1], np.random.default_rng(0))


def test_space_scales_clips_and_contains():
    space = DesignSpace((Variable("F", 4, 30, "Hz"), Variable("AoA", -10, 60, "deg")))
    X = np.array([[17.0, 25.0], [4.0, 60.0]])
    assert_allclose(space.scale(X), [[0.5, 0.5], [0.0, 1.0]])
    assert_allclose(space.unscale(space.scale(X)), X)
    assert list(space.contains([[4, 60], [3.9, 0]])) == [True, False]
    assert_allclose(space.clip([[50, -20]]), [[30, -10]])
    assert (space.names, space.dimension) == (("F", "AoA"), 2)


def test_space_refuses_a_name_twice():
    with pytest.raises(InputError, match="'F' is there 2 times"):
        DesignSpace((Variable("F", 0, 1), Variable("F", 0, 2)))
