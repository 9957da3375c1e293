# SPDX-License-Identifier: Apache-2.0
"""The benchmark measures the case it says."""

import pytest

from cwmav_sim.benchmark import Figures, sized_case


@pytest.mark.parametrize("particles", [2000, 24_000, 100_000])
def test_case_has_about_the_particles_asked_for(particles):
    flow = sized_case(particles).flow
    volume = 0.5 * flow.box.length * flow.box.width * flow.box.height
    assert volume / flow.resolution.dp**3 == pytest.approx(particles, rel=1e-6)


def test_figures_are_rates():
    figures = Figures(particles=1000, steps=50, seconds=2.0, neighbours=164.0, threads=2)
    content = figures.to_json()
    assert content["particle_steps_per_s"] == 25_000
    assert content["pair_interactions_per_s"] == 2 * 164 * 25_000
    assert (content["threads"], content["device"]) == (2, "cpu")
