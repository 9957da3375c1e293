# SPDX-License-Identifier: Apache-2.0
"""Gradient polish and the margin it is used with."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cwmav_common.errors import InputError
from cwmav_rbdo.grid_prediction import predict_on_grid
from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.lift_to_power import DirectRatio, LiftToPower
from cwmav_rbdo.polish import polish
from cwmav_rbdo.ratio_margin import RatioMargin
from cwmav_rbdo.sampling import latin_hypercube


def bowl(X):
    return (X[:, 0] - 0.3) ** 2 + 100.0 * (X[:, 1] - 40.0) ** 2


def test_reaches_the_optimum_from_nearby():
    found = polish(bowl, [0, 0], [1, 100], [0.35, 41.0])
    assert_allclose(found.x, [0.3, 40.0], rtol=1e-5)
    assert found.violation == 0.0


def test_meets_an_active_constraint():
    found = polish(bowl, [0, 0], [1, 100], [0.6, 41.0], [lambda X: X[:, 0] - 0.5])
    assert found.x[0] == pytest.approx(0.5, abs=1e-6)
    assert found.violation == 0.0


def test_optimum_on_a_bound_is_met_exactly_and_never_left():
    seen = []

    def watched(X):
        seen.append(X.copy())
        return -X[:, 0] + X[:, 1]

    found = polish(watched, [0, 0], [1, 2], [1.0, 0.5])
    assert np.array_equal(found.x, [1.0, 0.0])
    tried = np.vstack(seen)
    assert np.all((tried >= [0, 0]) & (tried <= [1, 2]))
    assert found.evaluations == len(tried)


def test_never_worse_than_the_start():
    rng = np.random.default_rng(0)

    def rough(X):
        return np.sin(900 * X[:, 0]) + X[:, 0]

    for start in rng.random((20, 1)):
        assert polish(rough, [0], [1], start).f <= rough(start[None])[0]


def test_start_outside_is_refused():
    with pytest.raises(InputError, match="start"):
        polish(bowl, [0, 0], [1, 100], [2.0, 3.0])


@pytest.fixture(scope="module")
def samples():
    X = latin_hypercube(25, [4, -10, 0], [30, 60, 6], np.random.default_rng(0))
    lift = 0.1 + 0.002 * X[:, 0] + 0.02 * np.sin(X[:, 1] / 20) + 0.005 * X[:, 2]
    return X, lift, 0.5 + 0.03 * X[:, 0] + 0.001 * X[:, 0] * X[:, 2]


@pytest.mark.parametrize("kernel", ["gaussian", "matern52"])
@pytest.mark.parametrize("trend", ["constant", "quadratic"])
def test_grid_prediction_equals_point_prediction(samples, kernel, trend):
    X, lift, _ = samples
    model = Kriging(kernel, trend).fit(X, lift)
    axes = [np.linspace(3, 31, 4), np.linspace(-11, 61, 5), np.linspace(0, 6, 3)]
    mesh = np.meshgrid(*axes, indexing="ij")
    expected = model.predict(np.stack([m.ravel() for m in mesh], axis=1)).reshape(4, 5, 3)
    assert_allclose(predict_on_grid(model, axes), expected, rtol=1e-5)


def test_grid_prediction_with_a_constant_variable(samples):
    X, lift, _ = samples
    flat = X.copy()
    flat[:, 1] = 15.0
    model = Kriging(trend="linear").fit(flat, lift)
    grid = predict_on_grid(model, [np.array([5.0, 9.0]), np.array([0.0, 15.0]), np.array([3.0])])
    assert_allclose(grid[:, 0], grid[:, 1])
    assert_allclose(grid[0, 0], model.predict([[5.0, 0.0, 3.0]]), rtol=1e-5)


@pytest.mark.parametrize("surrogate", [LiftToPower(), DirectRatio()])
@pytest.mark.parametrize("shift", [0.0, -1.96])
def test_margin_on_the_grid_equals_the_margin_at_points(samples, surrogate, shift):
    margin = RatioMargin(surrogate.fit(*samples), 0.1, shift)
    axes = [np.linspace(-20, 60, 5), np.linspace(-10, 60, 4), np.linspace(0, 6, 3)]
    mesh = np.meshgrid(*axes, indexing="ij")
    points = np.stack([m.ravel() for m in mesh], axis=1)
    assert_allclose(margin.on_grid(axes).ravel(), margin(points), rtol=1e-4, atol=1e-6)
    mean, std = margin.with_std(points)
    assert_allclose(margin(points), mean + shift * std, rtol=1e-7, atol=1e-9)
