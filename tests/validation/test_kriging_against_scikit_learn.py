# SPDX-License-Identifier: Apache-2.0
"""Kriging against scikit-learn: equal predictions for equal hyperparameters, and its own estimator checks."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose
from sklearn.exceptions import SkipTestWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern
from sklearn.model_selection import GridSearchCV, cross_val_score
from sklearn.utils.estimator_checks import check_estimator

from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.sampling import latin_hypercube

LENGTH = np.array([0.3, 0.6])
REGRESSORS = {"gaussian": RBF(LENGTH), "matern52": Matern(LENGTH, nu=2.5)}


def response(X):
    return np.sin(4 * X[:, 0]) + X[:, 1] ** 2


@pytest.mark.parametrize("kernel", REGRESSORS)
@pytest.mark.parametrize("noisy", [False, True])
def test_equal_hyperparameters_give_equal_predictions(kernel, noisy):
    """A constant trend of unknown size is the limit of a constant with a wide prior."""
    X = latin_hypercube(30, [0, 0], [1, 1], np.random.default_rng(0))
    y = response(X)
    noise = np.full(30, 1e-3 if noisy else 0.0)
    ours = Kriging(kernel, length_scale=LENGTH, nugget=1e-8).fit(X, y, noise if noisy else None)
    variance = ours.process_variance_
    prior = ConstantKernel(1e5) + ConstantKernel(variance) * REGRESSORS[kernel]
    theirs = GaussianProcessRegressor(prior, alpha=1e-8 * variance + noise, optimizer=None).fit(X, y)
    new = np.random.default_rng(1).random((50, 2))
    mean, std = ours.predict(new, return_std=True)
    their_mean, their_std = theirs.predict(new, return_std=True)
    assert_allclose(mean, their_mean, atol=2e-5)
    assert_allclose(std, their_std, atol=2e-4)


def test_likelihood_is_at_least_as_high_as_after_its_restarts():
    X = latin_hypercube(40, [0, 0], [1, 1], np.random.default_rng(2))
    y = response(X) - response(X).mean()
    y /= y.std()
    ours = Kriging("matern52").fit(X, y)
    kernel = ConstantKernel(1.0, (1e-3, 1e4)) * Matern([1.0, 1.0], (1e-2, 1e2), nu=2.5)
    theirs = GaussianProcessRegressor(kernel, alpha=1e-10, n_restarts_optimizer=5, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs.fit(X, y)
    # The mean is estimated here and zero there, so ours can only be higher.
    assert ours.log_likelihood_ >= theirs.log_marginal_likelihood_value_ - 1e-3


def test_passes_the_estimator_checks_of_scikit_learn():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SkipTestWarning)
        outcome = check_estimator(Kriging(), on_fail=None)
    failed = {
        entry["check_name"]: str(entry["exception"]) for entry in outcome if entry["status"] == "failed"
    }
    assert failed == {}
    assert sum(entry["status"] == "passed" for entry in outcome) > 30


def test_works_in_model_selection():
    X = latin_hypercube(40, [0, 0], [1, 1], np.random.default_rng(3))
    y = response(X)
    assert cross_val_score(Kriging(), X, y, cv=4).min() > 0.99
    search = GridSearchCV(
        Kriging(), {"trend": ["constant", "quadratic"], "kernel": ["gaussian", "matern52"]}, cv=3
    )
    assert search.fit(X, y).best_score_ > 0.99
