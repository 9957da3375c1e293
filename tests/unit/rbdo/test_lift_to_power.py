# SPDX-License-Identifier: Apache-2.0
"""The ratio of two surrogates: value, propagated error, gradient, guard against vanishing power."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import qmc

from cwmav_common.errors import InputError
from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.lift_to_power import DirectRatio, LiftToPower


def lift(X):
    return 0.1 + 0.05 * np.sin(3 * X[:, 0]) + 0.02 * X[:, 1]


def power(X):
    return 1.0 + 0.5 * X[:, 0] ** 2 + 0.2 * X[:, 1]


@pytest.fixture(scope="module")
def samples():
    X = qmc.LatinHypercube(2, rng=np.random.default_rng(0)).random(30)
    return X, lift(X), power(X)


@pytest.fixture(scope="module")
def new():
    return 0.1 + 0.8 * np.random.default_rng(1).random((40, 2))


@pytest.mark.parametrize("surrogate", [LiftToPower(), DirectRatio()])
def test_predicts_the_ratio(samples, new, surrogate):
    mean, std = surrogate.fit(*samples).predict(new)
    assert_allclose(mean, lift(new) / power(new), rtol=1e-3)
    assert_allclose(surrogate.mean(new), mean, rtol=1e-9)
    assert_allclose(surrogate.mse(new), std**2, rtol=1e-9)


@pytest.mark.parametrize("surrogate", [LiftToPower(), DirectRatio()])
def test_gradient_matches_differences(samples, new, surrogate):
    surrogate.fit(*samples)
    gradient = surrogate.gradient(new)
    for k in range(2):
        step = np.zeros(2)
        step[k] = 1e-4
        difference = (surrogate.mean(new + step) - surrogate.mean(new - step)) / 2e-4
        assert_allclose(gradient[:, k], difference, rtol=1e-3, atol=2e-5)


def test_propagated_error_is_the_spread_of_sampled_ratios(samples):
    X, L, P = samples
    model = LiftToPower().fit(X, L, P, np.full(30, 1e-6), np.full(30, 4e-4))
    point = np.array([[0.4, 0.6]])
    lift_mean, lift_mse = model.lift_.predict(point, return_mse=True)
    power_mean, power_mse = model.power_.predict(point, return_mse=True)
    rng = np.random.default_rng(0)
    ratios = (lift_mean + np.sqrt(lift_mse) * rng.standard_normal(200_000)) / (
        power_mean + np.sqrt(power_mse) * rng.standard_normal(200_000)
    )
    mean, std = model.predict(point)
    assert std[0] == pytest.approx(ratios.std(), rel=0.02)
    assert mean[0] == pytest.approx(ratios.mean(), rel=1e-3)


def test_noise_of_both_reaches_the_direct_surrogate(samples):
    X, L, P = samples
    model = DirectRatio().fit(X, L, P, np.full(30, 1e-6), np.full(30, 4e-4))
    expected = (1e-6 + (L / P) ** 2 * 4e-4) / P**2
    assert_allclose(model.ratio_.fitted_.noise * model.ratio_.y_scale_**2, expected, rtol=1e-9)


def test_vanishing_power_is_held_and_counts_as_error():
    X = np.array([[0.0], [0.2], [0.4]])
    model = LiftToPower(power=Kriging(trend="linear", length_scale=10.0))
    model.fit(X, [0.1, 0.1, 0.12], [1.0, 0.8, 0.6])
    far = np.array([[1.5]])
    assert model.power_.predict(far)[0] < model.power_floor_ == 0.3
    mean, std = model.predict(far)
    assert mean[0] == pytest.approx(model.lift_.predict(far)[0] / 0.3)
    assert std[0] > abs(mean[0])


@pytest.mark.parametrize("surrogate", [LiftToPower(), DirectRatio()])
def test_added_sample_is_met(samples, surrogate):
    X, L, P = samples
    surrogate.fit(X[:20], L[:20], P[:20]).add(X[20:], L[20:], P[20:])
    assert_allclose(surrogate.mean(X), L / P, rtol=1e-4)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_power_must_be_positive(samples, value):
    X, L, P = samples
    P = P.copy()
    P[3] = value
    with pytest.raises(InputError, match="in sample 3; must be finite and > 0"):
        LiftToPower().fit(X, L, P)
