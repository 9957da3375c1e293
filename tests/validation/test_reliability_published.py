# SPDX-License-Identifier: Apache-2.0
"""Published failure probabilities, judged against exact or brute-force values rather than the printed ones.

Sources: four branches, modified Rastrigin and lognormal sum: Echard, Gayton and Lemaire 2011 (Struct. Safety
33:145); Youn and Choi 2004 at their printed optimum. The references are a one-dimensional quadrature (four
branches), a Fourier inversion (lognormal sum) and Monte Carlo with 1e7 points (the others).
"""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import lognorm, norm

from cwmav_rbdo.reliability import (
    Copula,
    GaussianNoise,
    importance_sampling,
    line_root_estimate,
    monte_carlo,
    subset_simulation,
)


def four_branches(X):
    x1, x2, k = X[:, 0], X[:, 1], 6.0
    sideways, along = (x1 - x2), (x1 + x2) / math.sqrt(2.0)
    return np.minimum.reduce(
        [
            3.0 + 0.1 * sideways**2 - along,
            3.0 + 0.1 * sideways**2 + along,
            sideways + k / math.sqrt(2.0),
            -sideways + k / math.sqrt(2.0),
        ]
    )


def four_branches_exact():
    inside, _ = quad(lambda u: norm.pdf(u) * (2.0 * norm.cdf(3.0 + 0.2 * u * u) - 1.0), -3.0, 3.0)
    return 1.0 - inside


def rastrigin(X):
    return 10.0 - np.sum(X**2 - 5.0 * np.cos(2.0 * np.pi * X), axis=1)


def youn_choi(X):
    return X[:, 0] ** 2 * X[:, 1] / 20.0 - 1.0


def lognormal_sum(X):
    d = X.shape[1]
    return d + 3.0 * 0.2 * math.sqrt(d) - X.sum(axis=1)


SIGMA = math.sqrt(math.log(1.0 + 0.2**2))
STANDARD = GaussianNoise([0.0, 0.0], [1.0, 1.0])
AT_OPTIMUM = GaussianNoise([3.4391, 3.2866], [0.3, 0.3])
LOGNORMALS = Copula([lognorm(SIGMA, scale=math.exp(-0.5 * SIGMA**2))] * 40)


def test_the_reference_of_the_four_branches():
    assert four_branches_exact() == pytest.approx(4.45733e-3, rel=1e-5)


@pytest.mark.parametrize(
    ("g", "inputs", "exact"),
    [
        (four_branches, STANDARD, 4.45733e-3),
        (rastrigin, STANDARD, 7.294e-2),
        (youn_choi, AT_OPTIMUM, 1.4831e-3),
    ],
)
def test_monte_carlo(g, inputs, exact):
    estimate = monte_carlo(g, inputs, np.random.default_rng(0), 1_000_000)
    assert estimate.value == pytest.approx(exact, rel=0.05)
    assert abs(estimate.value - exact) < 4 * estimate.std


@pytest.mark.parametrize(
    ("g", "inputs", "exact", "samples"),
    [
        (four_branches, STANDARD, 4.45733e-3, 40_000),
        (rastrigin, STANDARD, 7.294e-2, 40_000),
        (youn_choi, AT_OPTIMUM, 1.4831e-3, 20_000),
        (lognormal_sum, LOGNORMALS, 1.98154e-3, 20_000),
    ],
)
def test_importance_sampling(g, inputs, exact, samples):
    estimate = importance_sampling(g, inputs, np.random.default_rng(0), samples)
    assert estimate.value == pytest.approx(exact, rel=0.05)


@pytest.mark.parametrize(
    ("g", "inputs", "exact"),
    [
        (four_branches, STANDARD, 4.45733e-3),
        (rastrigin, STANDARD, 7.294e-2),
        (youn_choi, AT_OPTIMUM, 1.4831e-3),
        (lognormal_sum, LOGNORMALS, 1.98154e-3),
    ],
)
def test_subset_simulation(g, inputs, exact):
    estimate = subset_simulation(g, inputs, np.random.default_rng(1), 40_000)
    assert abs(estimate.value - exact) < 3 * estimate.std
    assert estimate.std < 0.05 * exact


def test_line_root_of_smooth_and_of_branched_limit_states():
    at_optimum = line_root_estimate(youn_choi, AT_OPTIMUM.mean, AT_OPTIMUM.std)
    brute = monte_carlo(youn_choi, AT_OPTIMUM, np.random.default_rng(5), 4_000_000)
    assert abs(at_optimum.value - brute.value) < 3 * brute.std
    branched = line_root_estimate(four_branches, [0, 0], [1, 1], order=41)
    assert branched.value == pytest.approx(4.45733e-3, rel=0.01)
