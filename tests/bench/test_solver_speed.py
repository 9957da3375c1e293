# SPDX-License-Identifier: Apache-2.0
"""Speed of the complete solver: threads, and how cost grows with the particles."""

import numba
import pytest

from cwmav_sim.benchmark import measure

pytestmark = [pytest.mark.bench, pytest.mark.timeout(600)]


@pytest.fixture
def threads():
    before = numba.get_num_threads()
    yield numba.set_num_threads
    numba.set_num_threads(before)


def test_threads(benchmarks, threads):
    most = numba.get_num_threads()
    rates = []
    for count in (1, most):
        threads(count)
        figures = measure(100_000, seconds=8.0)
        rates.append(figures.pair_interactions_per_s)
        benchmarks.rate(
            f"SPH pairs of {figures.particles} particles, {count} thread(s)", 1e-6 * rates[-1], "million/s"
        )
    if most > 1:
        benchmarks.rate(f"SPH speed-up of {most} threads", rates[-1] / rates[0], "")
    assert min(rates) > 0.0


@pytest.mark.parametrize("particles", [20_000, 50_000, 200_000])
def test_particles(benchmarks, particles):
    figures = measure(particles, seconds=5.0)
    benchmarks.rate(
        f"SPH particle-steps of {figures.particles} particles",
        1e-6 * figures.particle_steps_per_s,
        "million/s",
    )
    assert figures.pair_gflops > 0.0
