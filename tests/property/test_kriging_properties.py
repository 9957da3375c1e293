# SPDX-License-Identifier: Apache-2.0
"""What no choice of units, order or origin may change."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cwmav_rbdo.kriging import Kriging
from cwmav_rbdo.lift_to_power import LiftToPower
from cwmav_rbdo.reliability import line_root
from cwmav_rbdo.sampling import latin_hypercube

scales = st.floats(1e-3, 1e3)
shifts = st.floats(-10.0, 10.0)
kernels = st.sampled_from(["gaussian", "matern52"])
trends = st.sampled_from(["constant", "linear", "quadratic", "auto"])
few = settings(max_examples=8, deadline=None)


def case(seed, n=18):
    rng = np.random.default_rng(seed)
    X = latin_hypercube(n, [0, 0], [1, 1], rng)
    y = np.sin(5 * X[:, 0]) + X[:, 1] ** 2 + 0.3 * X[:, 0] * X[:, 1]
    return X, y, rng.random((30, 2))


@few
@given(
    seed=st.integers(0, 5),
    scale=st.tuples(scales, scales),
    shift=st.tuples(shifts, shifts),
    kernel=kernels,
    trend=trends,
)
def test_units_and_origin_of_the_variables_do_not_matter(seed, scale, shift, kernel, trend):
    X, y, new = case(seed)
    scale, shift = np.array(scale), np.array(shift) * np.array(scale)
    plain = Kriging(kernel, trend).fit(X, y)
    moved = Kriging(kernel, trend).fit(X * scale + shift, y)
    for a, b in zip(
        plain.predict(new, return_std=True), moved.predict(new * scale + shift, return_std=True), strict=True
    ):
        assert_allclose(a, b, atol=2e-4)
    assert_allclose(plain.gradient(new), moved.gradient(new * scale + shift) * scale, atol=2e-3)
    assert plain.trend_ == moved.trend_


@few
@given(seed=st.integers(0, 5), scale=scales, shift=shifts, kernel=kernels, trend=trends)
def test_unit_and_origin_of_the_response_do_not_matter(seed, scale, shift, kernel, trend):
    X, y, new = case(seed)
    noise = np.full(len(y), 1e-4)
    mean, std = Kriging(kernel, trend).fit(X, y, noise).predict(new, return_std=True)
    moved = Kriging(kernel, trend).fit(X, scale * (y + shift), scale**2 * noise)
    moved_mean, moved_std = moved.predict(new, return_std=True)
    assert_allclose(moved_mean / scale - shift, mean, atol=2e-4)
    assert_allclose(moved_std / scale, std, atol=2e-4)


@few
@given(seed=st.integers(0, 5), order=st.permutations(range(18)), kernel=kernels, trend=trends)
def test_order_of_the_samples_does_not_matter(seed, order, kernel, trend):
    X, y, new = case(seed)
    order = list(order)
    plain, permuted = Kriging(kernel, trend).fit(X, y), Kriging(kernel, trend).fit(X[order], y[order])
    for a, b in zip(plain.predict(new, return_std=True), permuted.predict(new, return_std=True), strict=True):
        assert_allclose(a, b, atol=2e-4)


@few
@given(seed=st.integers(0, 5), kernel=kernels)
def test_order_of_the_variables_does_not_matter_once_the_length_scales_are_known(seed, kernel):
    X, y, new = case(seed)
    length = np.array([0.3, 0.7])
    plain = Kriging(kernel, "quadratic", length_scale=length, nugget=1e-9).fit(X, y)
    swapped = Kriging(kernel, "quadratic", length_scale=length[::-1], nugget=1e-9).fit(X[:, ::-1], y)
    assert_allclose(plain.predict(new), swapped.predict(new[:, ::-1]), atol=1e-6)


@few
@given(seed=st.integers(0, 5), kernel=kernels, trend=trends)
def test_a_sample_more_never_raises_the_error_for_given_hyperparameters(seed, kernel, trend):
    X, y, new = case(seed)
    model = Kriging(kernel, trend).fit(X, y)
    before = model.predict(new, return_mse=True)[1] / model.process_variance_
    model.add(new[:1], [0.5])
    after = model.predict(new, return_mse=True)[1] / model.process_variance_
    assert np.all(after <= before + 1e-6)


@few
@given(seed=st.integers(0, 5), scale=scales)
def test_unit_of_the_power_turns_up_in_the_ratio_alone(seed, scale):
    X, y, new = case(seed)
    power = 1.0 + X[:, 0]
    mean, std = LiftToPower().fit(X, y, power).predict(new)
    scaled_mean, scaled_std = LiftToPower().fit(X, y, scale * power).predict(new)
    assert_allclose(scaled_mean * scale, mean, atol=2e-4)
    assert_allclose(scaled_std * scale, std, atol=2e-4)


@few
@given(seed=st.integers(0, 50), scale=st.tuples(scales, scales), shift=st.tuples(shifts, shifts))
def test_units_do_not_change_a_reliability(seed, scale, shift):
    rng = np.random.default_rng(seed)
    designs, std = rng.uniform(2.5, 4.0, (5, 2)), np.array([0.3, 0.2])
    scale, shift = np.array(scale), np.array(shift)

    def g(X):
        return X[:, 0] ** 2 * X[:, 1] / 20.0 - 1.0

    plain, _, _ = line_root(g, designs, std)
    moved, _, _ = line_root(lambda X: g((X - shift) / scale), designs * scale + shift, std * scale)
    assert_allclose(moved, plain, rtol=1e-6, atol=1e-10)


@few
@given(seed=st.integers(0, 50), extra=st.floats(0.01, 1.0))
def test_a_looser_requirement_is_never_less_reliable(seed, extra):
    designs = np.random.default_rng(seed).uniform(2.0, 4.0, (5, 2))

    def g(X):
        return X[:, 0] ** 2 * X[:, 1] / 20.0 - 1.0

    tight, _, _ = line_root(g, designs, [0.3, 0.3])
    loose, _, _ = line_root(lambda X: g(X) + extra, designs, [0.3, 0.3])
    assert np.all(loose <= tight + 1e-6)
