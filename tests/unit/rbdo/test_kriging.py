# SPDX-License-Identifier: Apache-2.0
"""Universal Kriging: equations, gradients, recoveries, estimator manners."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import qmc

from cwmav_common.errors import InputError
from cwmav_rbdo.correlation import correlation
from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.likelihood import Likelihood
from cwmav_rbdo.trend import basis


def branin(Z):
    x, y = 15.0 * Z[:, 0] - 5.0, 15.0 * Z[:, 1]
    trough = y - 5.1 / (4.0 * np.pi**2) * x**2 + 5.0 / np.pi * x - 6.0
    return trough**2 + 10.0 * (1.0 - 1.0 / (8.0 * np.pi)) * np.cos(x) + 10.0


def hypercube(n, d, seed=0):
    return qmc.LatinHypercube(d, rng=np.random.default_rng(seed)).random(n)


@pytest.fixture(scope="module")
def branin_samples():
    X = hypercube(40, 2)
    return X, branin(X)


@pytest.mark.parametrize("kernel", ["gaussian", "matern52"])
@pytest.mark.parametrize("trend", ["constant", "linear", "quadratic"])
def test_interpolates_exact_samples(branin_samples, kernel, trend):
    X, y = branin_samples
    mean, mse = Kriging(kernel, trend).fit(X, y).predict(X, return_mse=True)
    assert_allclose(mean, y, atol=1e-4 * y.std())
    assert np.all(np.sqrt(mse) < 1e-3 * y.std())


def test_prediction_follows_appendix_i_written_out(branin_samples):
    """Eqs. 17 to 20 with plain inverses, in the units of the problem."""
    X, y = branin_samples
    length = np.array([0.2, 0.4])
    model = Kriging("matern52", "linear", length_scale=length, nugget=1e-10).fit(X, y)
    new = hypercube(30, 2, seed=5)

    def correlations(A, B):
        s = np.sum(((A[:, None, :] - B[None, :, :]) / length) ** 2, axis=2)
        return correlation("matern52").value(s)

    H, h = basis("linear", X), basis("linear", new)
    R_inv = np.linalg.inv(correlations(X, X) + 1e-10 * np.eye(len(X)))
    A_inv = np.linalg.inv(H.T @ R_inv @ H)
    v = A_inv @ H.T @ R_inv @ y
    variance = (y - H @ v) @ R_inv @ (y - H @ v) / len(y)
    r = correlations(new, X)
    u = r @ R_inv @ H - h
    mean, mse = model.predict(new, return_mse=True)
    assert_allclose(mean, h @ v + r @ R_inv @ (y - H @ v), rtol=1e-7)
    expected = variance * (1 - np.sum(r @ R_inv * r, axis=1) + np.sum(u @ A_inv * u, axis=1))
    assert_allclose(mse, expected, rtol=1e-6, atol=1e-9 * variance)
    assert model.process_variance_ == pytest.approx(variance, rel=1e-8)


@pytest.mark.parametrize("kernel", ["gaussian", "matern52"])
@pytest.mark.parametrize("trend", ["constant", "linear", "quadratic"])
def test_gradients_match_differences(branin_samples, kernel, trend):
    X, y = branin_samples
    model = Kriging(kernel, trend, length_scale=[0.25, 0.35], nugget=1e-8).fit(X * [2.0, 30.0], y, 0.01)
    model = Kriging(kernel, trend, length_scale=[0.5, 10.0], nugget=1e-8).fit(X * [2.0, 30.0], y)
    new = hypercube(7, 2, seed=9) * [2.0, 30.0]
    for k, step in enumerate((2e-5, 3e-4)):
        shift = np.zeros(2)
        shift[k] = step
        up, up_mse = model.predict(new + shift, return_mse=True)
        down, down_mse = model.predict(new - shift, return_mse=True)
        assert_allclose(model.gradient(new)[:, k], (up - down) / (2 * step), rtol=1e-5, atol=1e-5 * y.std())
        assert_allclose(
            model.mse_gradient(new)[:, k],
            (up_mse - down_mse) / (2 * step),
            rtol=1e-4,
            atol=1e-5 * model.process_variance_,
        )


@pytest.mark.parametrize("kernel", ["gaussian", "matern52"])
@pytest.mark.parametrize("noisy", [False, True])
@pytest.mark.parametrize("nugget", [1e-6, None])
def test_likelihood_gradient_matches_differences(kernel, noisy, nugget):
    X = hypercube(25, 3)
    f = np.sin(4 * X[:, 0]) + X[:, 1] * X[:, 2]
    noise = np.linspace(1e-4, 1e-2, 25) if noisy else np.zeros(25)
    likelihood = Likelihood(correlation(kernel), X, f, basis("linear", X), noise, nugget)
    p = np.log([0.5, 0.7, 0.9])
    p = np.concatenate([p, [np.log(0.8)] * noisy, [np.log(1e-3)] * (nugget is None)])
    _, gradient = likelihood(p)
    for k in range(len(p)):
        shift = np.zeros(len(p))
        shift[k] = 1e-5
        difference = (likelihood(p + shift)[0] - likelihood(p - shift)[0]) / 2e-5
        assert gradient[k] == pytest.approx(difference, rel=1e-4, abs=1e-7)


def test_closed_form_leave_one_out_is_leaving_one_out(branin_samples):
    X, y = branin_samples
    length = np.array([0.3, 0.5])
    settings = {"kernel": "matern52", "trend": "linear", "length_scale": length, "nugget": 1e-10}
    errors = []
    for i in range(len(X)):
        rest = np.arange(len(X)) != i
        errors.append(y[i] - Kriging(**settings).fit(X[rest], y[rest]).predict(X[i : i + 1])[0])
    whole = Kriging(**settings).fit(X, y)
    assert whole.loo_rmse_ == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=1e-4)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_auto_trend_takes_the_richer_one_only_where_it_helps(seed):
    X = hypercube(30, 2, seed)
    assert Kriging(trend="auto").fit(X, branin(X)).trend_ == "quadratic"
    waves = np.sin(9 * X[:, 0]) * np.cos(7 * X[:, 1])
    assert Kriging(trend="auto").fit(X, waves).trend_ == "constant"


def test_auto_trend_is_the_fit_of_that_trend():
    X, y, new = hypercube(30, 2), branin(hypercube(30, 2)), hypercube(20, 2, seed=1)
    chosen, given = Kriging(trend="auto").fit(X, y), Kriging(trend="quadratic").fit(X, y)
    assert_allclose(chosen.predict(new), given.predict(new), rtol=0.02, atol=0.02 * y.std())
    assert chosen.loo_log_density_ == pytest.approx(given.loo_log_density_, abs=0.5)


def test_auto_trend_stays_constant_when_a_richer_one_would_be_saturated():
    X = hypercube(6, 3)
    assert Kriging(trend="auto").fit(X, X.sum(axis=1) + X[:, 0] ** 2).trend_ == "constant"


def test_added_samples_equal_a_fit_with_the_same_hyperparameters(branin_samples):
    X, y = branin_samples
    grown = Kriging("matern52").fit(X[:30], y[:30]).add(X[30:31], y[30:31]).add(X[31:], y[31:])
    whole = Kriging("matern52", length_scale=grown.length_scale_).fit(X, y)
    new = hypercube(50, 2, seed=3)
    for a, b in zip(grown.predict(new, return_mse=True), whole.predict(new, return_mse=True), strict=True):
        assert_allclose(a, b, rtol=1e-5, atol=1e-6 * y.std())


def test_adding_a_known_sample_recovers(branin_samples):
    X, y = branin_samples
    model = Kriging().fit(X, y)
    before = model.predict(X)
    model.add(X[3:4], y[3:4])
    assert any("nugget" in note for note in model.recoveries_) or len(model.fitted_.X) == len(X) + 1
    assert_allclose(model.predict(X), before, atol=1e-2 * y.std())


def test_noise_per_point_weighs_the_samples():
    X = np.linspace(0, 1, 12)[:, None]
    y = np.sin(3 * X[:, 0])
    y[5] += 1.0
    noise = np.full(12, 1e-4)
    noise[5] = 1.0
    mean = Kriging().fit(X, y, noise).predict(X)
    assert abs(mean[5] - np.sin(3 * X[5, 0])) < 0.05
    assert np.max(np.abs(np.delete(mean - np.sin(3 * X[:, 0]), 5))) < 0.05


def test_estimated_nugget_finds_the_noise():
    rng = np.random.default_rng(2)
    X = np.linspace(0, 1, 150)[:, None]
    y = np.sin(6 * X[:, 0]) + 0.1 * rng.standard_normal(150)
    model = Kriging(nugget="estimate").fit(X, y)
    found = np.sqrt(model.fitted_.process.nugget * model.process_variance_)
    assert found == pytest.approx(0.1, rel=0.2)


def test_agreeing_replicates_are_merged(branin_samples):
    X, y = branin_samples
    doubled = Kriging().fit(np.vstack([X, X[:5]]), np.concatenate([y, y[:5]]))
    single = Kriging().fit(X, y)
    new = hypercube(20, 2, seed=8)
    assert_allclose(doubled.predict(new), single.predict(new), rtol=1e-9)
    assert doubled.recoveries_ == ("replicates merged: 45 samples at 40 points",)


def test_contradicting_replicates_become_noise():
    X = np.repeat(np.linspace(0, 1, 10), 2)[:, None]
    y = X[:, 0] ** 2 + 0.1 * np.tile([1.0, -1.0], 10)
    model = Kriging().fit(X, y)
    assert "noise standard deviation 0.141 assumed" in model.recoveries_[1]
    assert_allclose(model.predict(X), X[:, 0] ** 2, atol=0.1)


def test_constant_response_and_constant_variable_are_named():
    X = hypercube(8, 2)
    constant = Kriging().fit(X, np.full(8, 3.25))
    mean, mse = constant.predict(hypercube(4, 2, seed=1), return_mse=True)
    assert_allclose(mean, 3.25)
    assert_allclose(mse, 0.0, atol=1e-12)
    assert "constant response" in constant.recoveries_[0]
    padded = np.column_stack([X[:, 0], np.full(8, 3.0), X[:, 1]])
    padded_new = np.column_stack([X[:3, 0] + 0.01, np.full(3, 3.0), X[:3, 1]])
    full, plain = Kriging(trend="linear").fit(padded, branin(X)), Kriging(trend="linear").fit(X, branin(X))
    assert_allclose(full.predict(padded_new), plain.predict(padded_new[:, [0, 2]]), rtol=1e-9)
    assert np.all(full.gradient(padded_new)[:, 1] == 0.0)
    assert "constant variable left out: column 1" in full.recoveries_[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"X": [[1.0, np.nan], [2.0, 3.0]], "y": [1.0, 2.0]}, "NaN"),
        ({"X": [[1.0], [2.0]], "y": [1.0, np.inf]}, "infinity"),
        ({"X": [[1.0]], "y": [1.0]}, "minimum of 2"),
        ({"X": [[1.0], [2.0]], "y": [1e200, -3e200]}, "as large as 3e\\+200"),
        ({"X": [[1.0], [1.0]], "y": [1.0, 1.0]}, "at one point"),
        ({"X": [[1.0], [2.0]], "y": [1.0, 2.0], "noise_variance": [1.0, -1.0]}, "-1.0"),
        ({"X": [[1.0], [2.0]], "y": [1.0, 2.0], "noise_variance": [1.0]}, "shape"),
    ],
)
def test_bad_samples_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        Kriging().fit(**change)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kernel": "cubic"}, "kernel = 'cubic'"),
        ({"trend": "cubic"}, "trend = 'cubic'"),
        ({"nugget": "some"}, "nugget = 'some'"),
        ({"nugget": -1.0}, "nugget = -1"),
        ({"starts": 0}, "starts = 0"),
        ({"length_scale": [1.0, -1.0]}, "length_scale"),
    ],
)
def test_bad_settings_are_refused(branin_samples, settings, message):
    with pytest.raises(InputError, match=message):
        Kriging(**settings).fit(*branin_samples)


def test_too_few_samples_for_the_trend_say_how_many_are_needed():
    X = hypercube(6, 2)
    with pytest.raises(InputError, match="needs 7 different samples, got 6"):
        Kriging(trend="quadratic").fit(X, branin(X))


def test_same_seed_same_bits_and_pickle(branin_samples):
    X, y = branin_samples
    new = hypercube(20, 2, seed=4)
    first, second = Kriging(random_state=7).fit(X, y), Kriging(random_state=7).fit(X, y)
    assert np.array_equal(first.predict(new), second.predict(new))
    restored = pickle.loads(pickle.dumps(first))  # noqa: S301
    assert np.array_equal(restored.predict(new), first.predict(new))


def test_chunks_do_not_change_the_prediction(branin_samples, monkeypatch):
    model = Kriging().fit(*branin_samples)
    new = hypercube(100, 2, seed=6)
    whole = model.predict(new, return_mse=True)
    monkeypatch.setattr("cwmav_rbdo.kriging.BLOCK_ENTRIES", 7 * 40)
    for a, b in zip(model.predict(new, return_mse=True), whole, strict=True):
        assert_allclose(a, b, rtol=1e-6, atol=1e-4)
    assert_allclose(model.predict(new), whole[0], rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize("noisy", [False, True])
def test_screening_knows_the_likelihood_of_every_simpler_trend(noisy):
    X = hypercube(20, 2)
    noise = np.full(20, 1e-3 if noisy else 0.0)
    f = np.sin(4 * X[:, 0]) + X[:, 1] ** 2
    whole = Likelihood(correlation("gaussian"), X, f, basis("quadratic", X), noise, 1e-8)
    p = np.log([0.3, 0.8] + [0.7] * noisy)
    apart = [
        Likelihood(correlation("gaussian"), X, f, basis(trend, X), noise, 1e-8)(p)[0]
        for trend in ("constant", "linear", "quadratic")
    ]
    assert_allclose(whole.values(p, [1, 3, 6]), apart, rtol=1e-9)
    assert_allclose([whole.restricted(k)(p)[0] for k in (1, 3, 6)], apart, rtol=1e-9)
    assert len(set(np.round(apart, 6))) == 3
