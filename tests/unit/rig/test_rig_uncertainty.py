# SPDX-License-Identifier: Apache-2.0
"""Standard deviations of correlated records, their intervals, and distributions."""

import numpy as np
import pytest
from scipy import stats

from cwmav_rig.autoregression import memory_of
from cwmav_rig.distributions import fit_distributions
from cwmav_rig.physics.scatter import averaging_ratio, memory_process
from cwmav_rig.uncertainty import spread_of_cycles, spread_of_samples


def test_memory_of_a_known_process():
    """AR(1) with coefficient a: sums (1 + a) / (1 - a) and (1 + a^2) / (1 - a^2)."""
    a = 0.8
    record = memory_process(200_000, 1.0, -1.0 / np.log(a), 2.0, np.random.default_rng(0))
    memory = memory_of(record)
    assert memory.variance == pytest.approx(4.0, rel=0.03)
    assert memory.sum_correlations == pytest.approx((1 + a) / (1 - a), rel=0.05)
    assert memory.sum_squares == pytest.approx((1 + a**2) / (1 - a**2), rel=0.05)
    assert memory.kurtosis == pytest.approx(0.0, abs=0.1)


def test_memory_of_independent_and_alternating_values():
    rng = np.random.default_rng(1)
    independent = memory_of(rng.uniform(-1, 1, 20_000))
    assert independent.sum_correlations == pytest.approx(1.0, abs=0.1)
    assert independent.kurtosis == pytest.approx(-1.2, abs=0.05)
    assert memory_of(np.tile([1.0, -1.0], 500) + rng.normal(0, 0.5, 1000)).sum_correlations < 0.2
    assert memory_of(np.ones(50)).variance == 0.0


def test_averages_of_the_process_have_the_stated_variance():
    record = memory_process(400_000, 0.01, 0.37, 1.0, np.random.default_rng(2))
    averages = record.reshape(-1, 10).mean(axis=1)
    assert averages.var() == pytest.approx(averaging_ratio(0.1, 0.37), rel=0.03)


def coverage(records, truth):
    """Share of the intervals that hold the truth, and the root mean square of the estimates."""
    spreads = [spread_of_cycles(record) for record in records]
    held = [spread.std_low <= truth <= spread.std_high for spread in spreads]
    return np.mean(held), np.sqrt(np.mean([spread.std**2 for spread in spreads]))


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.8])
def test_the_interval_covers_the_truth_as_often_as_it_says(correlation):
    rng = np.random.default_rng(3)
    memory = -1.0 / np.log(correlation) if correlation else 1e-6
    records = [memory_process(350, 1.0, memory, 0.153, rng) for _ in range(300)]
    share, deviation = coverage(records, 0.153)
    assert 0.91 <= share <= 0.985  # 95 % within three standard errors of 300 trials
    assert deviation == pytest.approx(0.153, rel=0.02)


def test_independence_wrongly_assumed_would_not_cover():
    """The check above can fail: intervals of independent samples cover far less."""
    rng = np.random.default_rng(3)
    held = 0
    for _ in range(200):
        record = memory_process(350, 1.0, -1.0 / np.log(0.8), 1.0, rng)
        low, high = np.sqrt(record.var(ddof=1) * 349 / stats.chi2.ppf([0.975, 0.025], 349))
        held += low <= 1.0 <= high
    assert held / 200 < 0.75


def test_scatter_within_cycles_counts():
    """A sinusoid at the flapping frequency in noise: variance a^2 / 2 + sigma^2."""
    rng = np.random.default_rng(4)
    time = np.arange(30_000) / 1000.0
    bounds = np.arange(0.05, 29.95, 1 / 12)
    held = 0
    for _ in range(60):
        values = 15 + 0.43 * np.sin(2 * np.pi * 12 * time) + rng.normal(0, 0.3475, len(time))
        spread = spread_of_samples(time, values, bounds)
        held += spread.std_low <= 0.4624 <= spread.std_high
        assert spread.std == pytest.approx(0.4624, rel=0.03)
        assert spread.mean == pytest.approx(15.0, abs=0.01)
    assert held >= 52


def test_slow_scatter_across_cycles_widens_the_interval():
    rng = np.random.default_rng(5)
    time = np.arange(3000) / 100.0
    bounds = np.arange(0.05, 29.95, 1 / 12)
    spreads = [spread_of_samples(time, memory_process(3000, 0.01, 0.3, 1.0, rng), bounds) for _ in range(150)]
    assert np.median([s.degrees_of_freedom for s in spreads]) == pytest.approx(100, rel=0.15)
    assert 0.89 <= np.mean([s.std_low <= 1.0 <= s.std_high for s in spreads]) <= 1.0


def test_only_usable_cycles_count():
    time = np.arange(1000) / 100.0
    values = np.where(time < 5.0, 1.0, 9.0) + np.tile([0.1, -0.1], 500)
    bounds = np.arange(0.0, 10.01, 0.1)
    good = bounds[:-1] < 4.99
    assert spread_of_samples(time, values, bounds, good).mean == pytest.approx(1.0)


def test_few_or_equal_values_have_no_interval():
    few = spread_of_cycles(np.array([1.0, 2.0, 3.0]))
    assert (few.mean, few.std) == (2.0, 1.0)
    assert np.isnan(few.std_low)
    assert np.isnan(spread_of_cycles(np.array([])).mean)
    constant = spread_of_cycles(np.full(50, 3.0))
    assert (constant.std, constant.std_low, constant.std_high) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("name", "draw"),
    [
        ("normal", lambda rng: rng.normal(3, 2, 4000)),
        ("arcsine-normal", lambda rng: np.sin(rng.uniform(0, 2 * np.pi, 4000)) + rng.normal(0, 0.2, 4000)),
        ("skew-normal", lambda rng: stats.skewnorm.rvs(8, size=4000, random_state=rng)),
        ("student-t", lambda rng: rng.standard_t(3, 4000)),
        ("logistic", lambda rng: rng.logistic(1, 2, 4000)),
    ],
)
def test_the_right_distribution_is_found(name, draw):
    fits = fit_distributions(draw(np.random.default_rng(6)), 4000.0)
    assert fits[0].name == name
    assert fits[0].p_value > 0.01
    assert fits == tuple(sorted(fits, key=lambda fit: fit.bic))


def test_few_independent_samples_do_not_condemn_the_normal_distribution():
    values = np.sin(np.linspace(0, 300, 4000)) + np.random.default_rng(0).normal(0, 0.2, 4000)
    by_many, by_few = fit_distributions(values, 4000.0), fit_distributions(values, 6.0)
    worst = {fit.name: fit.p_value for fit in by_many}["normal"]
    assert worst < 0.01 < {fit.name: fit.p_value for fit in by_few}["normal"]
