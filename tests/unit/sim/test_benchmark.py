# SPDX-License-Identifier: Apache-2.0
"""The benchmark measures the case it says."""

import pytest

from cwmav_sim.benchmark import Figures, measure, sized_case
from cwmav_sim.machine import MachineLimits


@pytest.mark.parametrize("particles", [2000, 24_000, 100_000])
def test_case_has_about_the_particles_asked_for(particles):
    flow = sized_case(particles).flow
    volume = 0.5 * flow.box.length * flow.box.width * flow.box.height
    assert volume / flow.resolution.dp**3 == pytest.approx(particles, rel=1e-6)


def test_figures_are_rates():
    figures = Figures(
        particles=1000,
        steps=50,
        seconds=2.0,
        cpu_seconds=3.5,
        neighbours=164.0,
        threads=2,
        shares={"pairs": 0.9, "sort": 0.1},
        bytes_per_particle=300.0,
        limits=MachineLimits(gflops=100.0, bandwidth=20.0),
    )
    content = figures.to_json()
    assert content["particle_steps_per_s"] == 25_000
    assert content["pair_interactions_per_s"] == 2 * 164 * 25_000
    assert (content["wall_s"], content["cpu_s"]) == (2.0, 3.5)
    assert (content["threads"], content["device"]) == (2, "cpu")
    assert "time: pairs 90.0%, sort 10.0%" in figures.lines()


def test_measured_figures_account_for_the_time_and_the_memory():
    figures = measure(2000, seconds=0.2)
    assert 0.5 < sum(figures.shares.values()) <= 1.0
    assert 9 * 8 < figures.bytes_per_particle < 20_000  # at least the state itself
    # No time against another time: a machine that serves others may be slow in one of the two measurements.
    assert figures.pair_gflops > 0.0
    assert min(figures.limits.gflops, figures.limits.bandwidth) > 0.0
