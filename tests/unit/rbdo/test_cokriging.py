# SPDX-License-Identifier: Apache-2.0
"""Forrester's pair of functions (Forrester, Sobester and Keane 2007, Proc. R. Soc. A 463:3251)."""

import numpy as np
import pytest
from sklearn.base import clone

from cwmav_common.errors import InputError
from cwmav_rbdo.cokriging import CoKriging
from cwmav_rbdo.kriging import Kriging

NEW = np.linspace(0.0, 1.0, 201)[:, None]
FINE_AT = np.array([0.0, 0.4, 0.6, 1.0])


def fine(x):
    return (6.0 * x - 2.0) ** 2 * np.sin(12.0 * x - 4.0)


def coarse(x):
    return 0.5 * fine(x) + 10.0 * (x - 0.5) - 5.0


def pair(coarse_at):
    X = np.concatenate([coarse_at, FINE_AT])[:, None]
    spacing = np.repeat([8.0, 4.0], [len(coarse_at), len(FINE_AT)])
    y = np.concatenate([coarse(coarse_at), fine(FINE_AT)])
    return X, y, spacing


def error(model):
    return np.sqrt(np.mean((model.predict(NEW) - fine(NEW[:, 0])) ** 2))


@pytest.mark.parametrize("nested", [True, False])
def test_four_fine_runs_and_eleven_coarse_ones_tell_what_four_cannot(nested):
    at = np.linspace(0.0, 1.0, 11 if nested else 12)
    X, y, spacing = pair(at)
    joint = CoKriging(discrepancy=Kriging(trend="linear")).fit(X, y, spacing)
    alone = Kriging().fit(FINE_AT[:, None], fine(FINE_AT))
    assert error(alone) > 3.0
    assert error(joint) < 0.1
    assert joint.rho_ == pytest.approx([2.0], abs=0.02)
    assert joint.spacings_.tolist() == [8.0, 4.0]


def test_fine_samples_are_interpolated_and_have_no_error():
    X, y, spacing = pair(np.linspace(0.0, 1.0, 11))
    model = CoKriging().fit(X, y, spacing)
    mean, mse = model.predict(FINE_AT[:, None], return_mse=True)
    assert mean == pytest.approx(fine(FINE_AT), abs=1e-3)
    assert np.sqrt(mse).max() < 0.02 * np.ptp(fine(NEW))
    assert np.sqrt(model.predict(NEW, return_mse=True)[1]) == pytest.approx(model.predict(NEW, True)[1])


def test_one_level_is_plain_kriging():
    X, y = NEW[::20], fine(NEW[::20, 0])
    alone, single = Kriging().fit(X, y), CoKriging().fit(X, y, np.full(len(y), 8.0))
    for a, b in zip(alone.predict(NEW, return_std=True), single.predict(NEW, return_std=True), strict=True):
        assert b == pytest.approx(a, abs=1e-3)
    assert len(single.rho_) == 0


def test_three_levels_chain():
    rng = np.random.default_rng(0)
    X = rng.random((40, 1))
    spacing = np.repeat([8.0, 4.0, 2.0], [20, 12, 8])
    truth = {8.0: lambda x: np.sin(6 * x), 4.0: lambda x: 1.5 * np.sin(6 * x) + x}
    truth[2.0] = lambda x: 0.8 * truth[4.0](x) - 0.3
    y = np.array([float(truth[s](x[0])) for x, s in zip(X, spacing, strict=True)])
    model = CoKriging().fit(X, y, spacing)
    assert model.predict(NEW) == pytest.approx(truth[2.0](NEW[:, 0]), abs=0.02)


def test_gradients_match_differences():
    X, y, spacing = pair(np.linspace(0.0, 1.0, 11))
    model = CoKriging().fit(X, y, spacing)
    at, h = np.array([[0.23], [0.71]]), 1e-5
    slope = (model.predict(at + h) - model.predict(at - h)) / (2 * h)
    assert model.gradient(at)[:, 0] == pytest.approx(slope, rel=1e-4)
    up, down = (model.predict(at + s, return_mse=True)[1] for s in (h, -h))
    assert model.mse_gradient(at)[:, 0] == pytest.approx((up - down) / (2 * h), rel=2e-2, abs=1e-4)


def test_noise_of_the_coarse_runs_is_felt():
    X, y, spacing = pair(np.linspace(0.0, 1.0, 11))
    noise = np.where(spacing == 8.0, 0.25, 0.0)
    exact, noisy = CoKriging().fit(X, y, spacing), CoKriging().fit(X, y, spacing, noise)
    middle = np.array([[0.5]])
    assert noisy.predict(middle, return_mse=True)[1] > exact.predict(middle, return_mse=True)[1]


def test_a_fine_sample_more_is_met():
    X, y, spacing = pair(np.linspace(0.0, 1.0, 11))
    model = CoKriging().fit(X, y, spacing)
    at = np.array([[0.77]])
    before, std = model.predict(at, return_std=True)
    model.add(at, fine(at[:, 0]))
    after, smaller = model.predict(at, return_std=True)
    assert abs(after[0] - fine(0.77)) < 0.3 * abs(before[0] - fine(0.77))
    assert smaller < std


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"spacing": np.repeat([8.0, 4.0], [13, 2])}, "spacing 4: 2 samples; a finer level needs at least 3"),
        ({"spacing": np.zeros(15)}, "spacing: 0.0 is not allowed"),
        ({"spacing": np.ones(3)}, "expected \\(n, d\\), \\(n,\\) and \\(n,\\)"),
        ({"y": np.full(15, np.nan)}, "NaN"),
    ],
)
def test_bad_samples_are_refused(change, message):
    X, y, spacing = pair(np.linspace(0.0, 1.0, 11))
    with pytest.raises(InputError, match=message):
        CoKriging().fit(**({"X": X, "y": y, "spacing": spacing} | change))


def test_settings_are_cloned():
    model = clone(CoKriging(coarse=Kriging("matern52")))
    assert model.get_params()["coarse__kernel"] == "matern52"
