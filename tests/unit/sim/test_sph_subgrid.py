# SPDX-License-Identifier: Apache-2.0
"""The subgrid stress: exact for a linear shear, without a net force, and only where asked for."""

from dataclasses import replace

import numpy as np
import pytest

from cwmav_sim.solver import Solver
from cwmav_sim.sph.settings import Box, FlowSettings, Fluid, Fringe, Resolution
from cwmav_sim.sph.subgrid import SMAGORINSKY
from cwmav_sim.verification.plates import OscillatingPlate

DP = 0.0125
CALM = FlowSettings(
    fluid=Fluid(sound_speed=20.0, viscosity=0.0, turbulence="sps"),
    resolution=Resolution(dp=DP, cfl=0.4, precision="double", jitter=0.0),
    box=Box(length=0.2, width=0.2, height=0.2, upstream=0.1, symmetric=False),
    fringe=Fringe(width=0.0),
)


def first_change(settings, speed, motion=None):
    """Change of velocity in the first step over its length, for an initial velocity along x."""
    solver = Solver(settings, motion, 0.0, highest_speed=1.0)
    solver.velocity[:, 0] = speed(solver.position)
    before, x = solver.velocity.copy(), solver.position.copy()
    info = solver.step()
    after = solver.velocity[np.argsort(solver.identity)]  # numbers count the particles as they began
    return (after - before) / info.dt, x


def test_eddies_brake_a_wave_of_shear_as_their_formula_says():
    waves = 64 * DP
    k = 2.0 * np.pi / waves
    box = Box(length=12 * DP, width=1.0, height=waves, symmetric=False, dimensions=2)
    flow = replace(CALM, box=box)

    def wave(x):
        return np.sin(k * x[:, 2])

    rate, x = first_change(flow, wave)
    plain, _ = first_change(replace(flow, fluid=replace(flow.fluid, turbulence="none")), wave)
    # tau_xz/rho = nu_t du/dz with nu_t = (C_s L)^2 |du/dz|; half the rate acts over the predictor too.
    mixing = SMAGORINSKY**2 * DP**2 / 2.0
    exact = -2.0 * mixing * k**3 * np.abs(np.cos(k * x[:, 2])) * np.sin(k * x[:, 2])
    steep = np.abs(np.cos(k * x[:, 2])) > 0.3
    error = np.abs((rate - plain)[steep, 0] - exact[steep])
    assert error.max() < 0.08 * np.abs(exact).max()


def test_stress_gives_no_momentum_and_stops_at_a_wall():
    plate = OscillatingPlate(chord=0.1, span=0.1, spacing=DP, amplitude=0.0, frequency=8.0)

    def shear(x):
        return np.where(x[:, 2] > 0.0, 1.0, -1.0)

    laminar = replace(CALM, fluid=replace(CALM.fluid, turbulence="none"))
    free, x = first_change(CALM, shear)
    assert abs(free.sum(axis=0)[0]) < 1e-9 * np.abs(free[:, 0]).sum()
    walled = first_change(CALM, shear, plate)[0] - first_change(laminar, shear, plate)[0]
    shielded = (np.abs(x[:, :2]) < 0.02).all(axis=1) & (np.abs(x[:, 2]) < DP)
    assert np.abs(walled[shielded, 0]).max() < 0.2 * np.abs(free[shielded, 0]).min()


@pytest.mark.parametrize("symmetric", [True, False])
def test_half_a_model_has_the_same_stress(symmetric):
    box = replace(CALM.box, symmetric=symmetric)
    rate, x = first_change(replace(CALM, box=box), lambda x: np.cos(2.0 * np.pi / 0.2 * x[:, 1]))
    row = (x[:, 0] > 0.0) & (x[:, 0] < DP) & (x[:, 2] > 0.0) & (x[:, 2] < DP) & (x[:, 1] > 0.0)
    profile = rate[row, 0][np.argsort(x[row, 1])]
    np.testing.assert_allclose(profile, -profile[::-1], atol=1e-9 * np.abs(profile).max())
    assert profile[1] < 0.0
