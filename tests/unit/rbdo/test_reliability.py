# SPDX-License-Identifier: Apache-2.0
"""Reliability methods on limit states with known probability of failure."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2, lognorm, norm, uniform

from cwmav_common.errors import InputError, WorkError
from cwmav_rbdo.reliability import (
    ConvolvedField,
    Copula,
    Estimate,
    GaussianNoise,
    certified,
    directional,
    form,
    importance_sampling,
    line_root,
    line_root_estimate,
    line_sampling,
    monte_carlo,
    monte_carlo_band,
    monte_carlo_designs,
    subset_simulation,
)

PLANE = np.array([0.6, 0.8])


def plane(X):
    """Fails with probability Phi(-3) under unit scatter about the origin."""
    return 3.0 - X @ PLANE


def parabola(X):
    """Fails above x2 = 3 + 0.1 x1^2."""
    return 3.0 + 0.1 * X[:, 0] ** 2 - X[:, 1]


def parabola_exact():
    nodes, weights = np.polynomial.hermite_e.hermegauss(40)
    return float(weights @ norm.sf(3.0 + 0.1 * nodes**2) / weights.sum())


STANDARD = GaussianNoise([0.0, 0.0], [1.0, 1.0])
METHODS = {
    "monte_carlo": lambda g, inputs, rng: monte_carlo(g, inputs, rng, 400_000),
    "importance_sampling": importance_sampling,
    "subset_simulation": subset_simulation,
    "line_sampling": line_sampling,
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("g", "exact"), [(plane, norm.sf(3.0)), (parabola, parabola_exact())])
def test_sampling_methods_agree_with_their_standard_error(method, g, exact):
    estimate = METHODS[method](g, STANDARD, np.random.default_rng(1))
    assert estimate.method == method
    assert abs(estimate.value - exact) < 4.0 * estimate.std
    assert estimate.std < 0.15 * exact


@pytest.mark.parametrize("method", ["importance_sampling", "subset_simulation"])
def test_standard_error_is_the_spread_of_repetitions(method):
    runs = [METHODS[method](parabola, STANDARD, np.random.default_rng(seed)) for seed in range(60)]
    spread = np.std([run.value for run in runs], ddof=1)
    assert np.mean([run.std for run in runs]) == pytest.approx(spread, rel=0.4)
    assert np.mean([run.value for run in runs]) == pytest.approx(
        parabola_exact(), abs=4 * spread / math.sqrt(60)
    )


@pytest.mark.parametrize("method", METHODS)
def test_same_seed_same_bits(method):
    runs = [METHODS[method](parabola, STANDARD, np.random.default_rng(3)) for _ in range(2)]
    assert runs[0] == runs[1]


def test_evaluations_are_what_was_called():
    for method in METHODS.values():
        calls = []

        def counted(X, calls=calls):
            calls.append(len(X))
            return parabola(X)

        estimate = method(counted, STANDARD, np.random.default_rng(0))
        assert estimate.evaluations == sum(calls)


def test_form_is_exact_for_a_plane_and_first_order_for_a_parabola():
    assert form(plane, STANDARD).value == pytest.approx(norm.sf(3.0), rel=1e-6)
    assert form(plane, STANDARD).beta == pytest.approx(3.0)
    assert form(parabola, STANDARD).value == pytest.approx(norm.sf(3.0), rel=1e-4)
    assert math.isnan(form(parabola, STANDARD).std)


def test_form_of_a_design_that_fails_on_average():
    assert form(lambda X: -plane(X), STANDARD).value == pytest.approx(norm.cdf(3.0), rel=1e-6)


def test_form_finds_a_way_out_of_a_symmetric_origin():
    estimate = form(lambda X: 9.0 - X[:, 0] ** 2, GaussianNoise([0.0], [1.0]))
    assert estimate.value == pytest.approx(norm.sf(3.0), rel=1e-3)


def test_form_says_when_nothing_is_found():
    with pytest.raises(WorkError, match="none of 3 searches"):
        form(lambda X: np.ones(len(X)), STANDARD, starts=3)


def test_importance_sampling_adds_up_separate_regions():
    estimate = importance_sampling(lambda X: 3.0 - np.abs(X[:, 0]), STANDARD, np.random.default_rng(0))
    assert estimate.value == pytest.approx(2.0 * norm.sf(3.0), rel=0.1)


def test_subset_simulation_reaches_rare_events():
    estimate = subset_simulation(lambda X: 5.0 - X @ PLANE, STANDARD, np.random.default_rng(0))
    assert estimate.value == pytest.approx(norm.sf(5.0), rel=0.5)
    with pytest.raises(WorkError, match="no failure within"):
        subset_simulation(lambda X: 60.0 - X[:, 0], STANDARD, np.random.default_rng(0), samples=100)


def test_copula_gives_marginals_and_correlation():
    marginals = [lognorm(0.25, scale=2.0), uniform(1.0, 4.0)]
    U = np.random.default_rng(0).standard_normal((200_000, 2))
    X = Copula(marginals, [[1.0, 0.6], [0.6, 1.0]]).from_standard(U)
    assert_allclose(X.mean(axis=0), [m.mean() for m in marginals], rtol=5e-3)
    assert_allclose(X.std(axis=0), [m.std() for m in marginals], rtol=1e-2)
    Z = np.column_stack([norm.ppf(m.cdf(column)) for m, column in zip(marginals, X.T, strict=True)])
    assert np.corrcoef(Z.T)[0, 1] == pytest.approx(0.6, abs=0.01)


def test_copula_keeps_the_far_upper_tail():
    X = Copula([norm(0.0, 1.0)]).from_standard(np.array([[9.0], [-9.0]]))
    assert_allclose(X[:, 0], [9.0, -9.0], rtol=1e-9)


def test_correlated_normal_scatter():
    inputs = GaussianNoise([1.0, 2.0], [0.5, 0.25], [[1.0, 0.5], [0.5, 1.0]])
    std = math.sqrt(0.5**2 + 0.25**2 + 2 * 0.5 * 0.5 * 0.25)
    estimate = form(lambda X: 5.0 - X.sum(axis=1), inputs)
    assert estimate.value == pytest.approx(norm.sf(2.0 / std), rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0], [-1.0]), "std >= 0"),
        (([0.0, 1.0], [1.0]), "shapes"),
        (([0.0, np.nan], [1.0, 1.0]), "finite"),
        (([0.0, 0.0], [1.0, 1.0], [[1.0, 1.1], [1.1, 1.0]]), "not positive definite"),
        (([0.0, 0.0], [1.0, 1.0], [[1.0, 0.5], [0.2, 1.0]]), "symmetric"),
    ],
)
def test_wrong_noise_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        GaussianNoise(*arguments)


def test_limit_state_that_gives_nan_or_a_wrong_shape_is_named():
    with pytest.raises(InputError, match="NaN at"):
        monte_carlo(lambda X: np.full(len(X), np.nan), STANDARD, np.random.default_rng(0), 100)
    with pytest.raises(InputError, match="returned shape"):
        monte_carlo(lambda X: X, STANDARD, np.random.default_rng(0), 100)


def test_no_failure_seen_still_has_an_error():
    estimate = monte_carlo(lambda X: np.ones(len(X)), STANDARD, np.random.default_rng(0), 1000)
    assert estimate.value == 0.0
    assert estimate.std == pytest.approx(1e-3, rel=0.1)
    assert estimate.beta == math.inf


def test_estimate_speaks_reliability():
    estimate = Estimate(norm.sf(3.0), 1e-5, 10, "any")
    assert estimate.reliability == pytest.approx(0.9986501)
    assert estimate.beta == pytest.approx(3.0)


def test_band_widens_with_the_uncertainty_of_the_surrogate():
    def uncertain(X):
        return plane(X), np.full(len(X), 0.5)

    band = monte_carlo_band(uncertain, STANDARD, np.random.default_rng(0), 300_000)
    low, high = band.reliability
    assert low < band.expected.reliability < band.mean_surface.reliability < high
    assert band.expected.value == pytest.approx(norm.sf(3.0 / math.sqrt(1.25)), rel=0.05)
    assert band.high.value == pytest.approx(norm.sf(3.0 - 0.98), rel=0.05)
    certain = monte_carlo_band(
        lambda X: (plane(X), np.zeros(len(X))), STANDARD, np.random.default_rng(0), 10_000
    )
    assert certain.low == certain.high == certain.mean_surface
    assert certain.expected.value == certain.mean_surface.value


def test_many_designs_at_once_by_monte_carlo():
    designs = np.array([[0.0, 0.0], [1.2, 1.6]])
    pf, std = monte_carlo_designs(plane, designs, [1.0, 1.0], np.random.default_rng(0), 100_000)
    assert np.all(np.abs(pf - norm.sf([3.0, 1.0])) < 4 * std)


def test_line_root_is_exact_for_planes_in_any_direction():
    for d in (1, 2, 3, 4):
        for axis in np.random.default_rng(d).standard_normal((5, d)):
            axis /= np.linalg.norm(axis)
            pf, _, _ = line_root(lambda X, a=axis: 2.5 - X @ a, np.zeros((1, d)), np.ones(d))
            assert pf[0] == pytest.approx(norm.sf(2.5), rel=1e-6)


def test_line_root_of_curved_and_split_failure():
    assert line_root_estimate(parabola, [0, 0], [1, 1]).value == pytest.approx(parabola_exact(), rel=1e-6)
    inside = line_root_estimate(lambda X: np.abs(X[:, 0]) - 0.5, [0.0], [1.0])
    assert inside.value == pytest.approx(norm.cdf(0.5) - norm.cdf(-0.5), rel=1e-6)
    outside = line_root_estimate(lambda X: 0.5 - np.abs(X[:, 0]), [0.0], [1.0])
    assert outside.value == pytest.approx(2 * norm.sf(0.5), rel=1e-6)


def test_line_root_error_estimate_covers_a_sharp_corner():
    def corner(X):
        return 2.0 - np.maximum(X[:, 0], X[:, 1])

    exact = 1.0 - norm.cdf(2.0) ** 2
    estimate = line_root_estimate(corner, [0, 0], [1, 1], order=25)
    assert estimate.std > 0
    assert abs(estimate.value - exact) < 2 * estimate.std
    assert estimate.value == pytest.approx(exact, rel=0.02)


def test_line_root_passes_variables_without_scatter_through():
    pf, _, _ = line_root(lambda X: X[:, 1] - X[:, 0], [[0.0, 2.0], [0.0, 1.0]], [1.0, 0.0])
    assert_allclose(pf, norm.sf([2.0, 1.0]), rtol=1e-6)
    pf, error, _ = line_root(lambda X: X[:, 0], [[1.0], [-1.0]], [0.0])
    assert_allclose(pf, [0.0, 1.0])
    assert_allclose(error, 0.0)


def test_line_root_counts_its_evaluations():
    calls = []

    def counted(X):
        calls.append(len(X))
        return parabola(X)

    _, _, evaluations = line_root(counted, np.zeros((3, 2)), [1.0, 1.0])
    assert evaluations == sum(calls)


def test_line_root_limits_are_named():
    with pytest.raises(InputError, match="5 scattering variables"):
        line_root(plane, np.zeros((1, 5)), np.ones(5))
    with pytest.raises(InputError, match="order = 2"):
        line_root(plane, np.zeros((1, 2)), np.ones(2), order=2)
    with pytest.raises(InputError, match="std"):
        line_root(plane, np.zeros((1, 2)), np.ones(3))


@pytest.mark.parametrize(("step", "tolerance"), [(1.0, 1.2e-2), (0.7, 6e-3), (0.5, 4e-3)])
def test_convolved_field_follows_line_root(step, tolerance):
    def product(X):
        return X[:, 0] ** 2 * X[:, 1] / 20.0 - 1.0

    std = [0.3, 0.3]
    field = ConvolvedField(product, [2, 2], [5, 5], std, step)
    X = np.random.default_rng(0).uniform(2, 5, (500, 2))
    assert_allclose(field.failure_probability(X), line_root(product, X, std)[0], atol=tolerance)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_convolved_field_of_a_plane_is_nearly_exact(d):
    normal = np.ones(d) / math.sqrt(d)
    field = ConvolvedField(lambda X: X @ normal, -3 * np.ones(d), 3 * np.ones(d), 0.5 * np.ones(d), 0.7)
    X = np.random.default_rng(0).uniform(-3, 3, (300, d))
    assert_allclose(field.failure_probability(X), norm.cdf(-(X @ normal) / 0.5), atol=5e-4)


def test_convolved_field_takes_a_grid_function():
    class OnGrid:
        asked = 0

        def on_grid(self, axes):
            self.asked += 1
            return axes[0][:, None] + 0.0 * axes[1][None, :]

    g = OnGrid()
    field = ConvolvedField(g, [-1, -1], [1, 1], [0.2, 0.2])
    assert g.asked == 1
    assert field.failure_probability([[0.3, 0.0]])[0] == pytest.approx(norm.sf(1.5), abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0] * 4, [1] * 4, [1] * 4), "at most 3"),
        (([0], [1], [0.0]), "numbers > 0"),
        (([0], [1], [1.0], 2.0), "step 2.0"),
        (([0, 0, 0], [1, 1, 1], [1e-3] * 3), "grid points"),
    ],
)
def test_convolved_field_limits_are_named(arguments, message):
    with pytest.raises(InputError, match=message):
        ConvolvedField(plane, *arguments)


def test_line_sampling_is_exact_for_a_plane_and_counts_both_sides():
    inputs = GaussianNoise(np.zeros(3), np.ones(3))
    found = line_sampling(lambda X: plane(X[:, :2]), inputs, np.random.default_rng(0), lines=20)
    assert found.value == pytest.approx(norm.sf(3.0), rel=1e-6)
    assert found.std < 1e-9
    band = line_sampling(lambda X: 2.0 - np.abs(X[:, 0]), inputs, np.random.default_rng(0), 20, [1, 0, 0])
    assert band.value == pytest.approx(2.0 * norm.sf(2.0), rel=1e-3)


def test_line_sampling_along_a_poor_direction_is_right_within_its_error():
    inputs = GaussianNoise(np.zeros(2), np.ones(2))
    found = line_sampling(
        lambda X: 2.5 - X[:, 0] - 0.1 * X[:, 1] ** 2, inputs, np.random.default_rng(0), 4000, [0.3, 1.0]
    )
    exact = monte_carlo(
        lambda X: 2.5 - X[:, 0] - 0.1 * X[:, 1] ** 2, inputs, np.random.default_rng(1), 2_000_000
    )
    assert abs(found.value - exact.value) < 4.0 * found.std
    assert found.std > 0.0


def test_line_sampling_refuses_what_is_no_direction():
    inputs = GaussianNoise(np.zeros(2), np.ones(2))
    for arguments, message in (({"direction": [0.0, 0.0]}, "not all zero"), ({"lines": 1}, "lines = 1")):
        with pytest.raises(InputError, match=message):
            line_sampling(lambda X: X[:, 0], inputs, np.random.default_rng(0), **arguments)


def bowl(X):
    """Failed outside of the ellipse of 3 and 4 about (1, 2)."""
    return 1.0 - ((X[:, 0] - 1.0) / 3.0) ** 2 - ((X[:, 1] - 2.0) / 4.0) ** 2


def test_directional_quadrature_where_failure_lies_all_around():
    circle = np.array([[1.0, 2.0]])
    pf, error, _ = directional(bowl, circle, [3.0 / 3.5, 4.0 / 3.5])  # a circle of 3.5 standard deviations
    assert pf[0] == pytest.approx(math.exp(-(3.5**2) / 2), rel=1e-6)
    sphere, _, _ = directional(lambda X: 9.0 - np.sum(X**2, axis=1), np.zeros((1, 3)), np.ones(3))
    assert sphere[0] == pytest.approx(chi2.sf(9.0, 3), rel=1e-6)
    assert error[0] < 1e-6


def test_directional_quadrature_of_a_plane_one_variable_and_no_scatter():
    pf, error, _ = directional(plane, np.zeros((1, 2)), [1.0, 1.0])
    assert pf[0] == pytest.approx(norm.sf(3.0), rel=1e-3)
    assert error[0] < 1e-5
    one, _, _ = directional(lambda X: 2.0 - X[:, 0], np.zeros((1, 2)), [1.0, 0.0])
    assert one[0] == pytest.approx(norm.sf(2.0), rel=1e-6)
    none, _, _ = directional(bowl, np.array([[1.0, 2.0], [9.0, 9.0]]), [0.0, 0.0])
    assert none.tolist() == [0.0, 1.0]


def test_certified_reliability_is_that_of_the_better_quadrature():
    designs = np.array([[1.0, 2.0], [3.5, 2.0]])
    pf, error = certified(bowl, designs, [0.8, 1.1])
    rng = np.random.default_rng(0)
    for design, value, reported in zip(designs, pf, error, strict=True):
        crude = monte_carlo(bowl, GaussianNoise(design, [0.8, 1.1]), rng, 2_000_000)
        assert abs(value - crude.value) < 4.0 * crude.std + reported
        assert reported < 1e-4
    with pytest.raises(InputError, match="directional: 4 scattering variables, at most 3"):
        directional(lambda X: X[:, 0], np.zeros((1, 4)), np.ones(4))
