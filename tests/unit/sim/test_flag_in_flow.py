# SPDX-License-Identifier: Apache-2.0
"""Parts of the case FSI2: the surface of the flag, its inflow, and how the swing is read off."""

import numpy as np
import pytest

from cwmav_sim.sph.sheet import Compliant, Solid
from cwmav_sim.verification.flag_in_flow import FlagSkin, Inflow, flag_in_channel, frequency
from cwmav_sim.verification.structure_flag import NO_BODIES, flag
from cwmav_sim.wing.statics import at_rest


@pytest.fixture
def body():
    return flag(6, 1, 10.0, 1400.0)


def test_surface_goes_round_the_flag_and_hands_on_every_force(body):
    skin = FlagSkin(body, 0.01)
    c = at_rest(body.x, NO_BODIES)
    x = skin.state(c, np.zeros_like(body.x)).x
    assert x[:, 2].min() == pytest.approx(-0.205 + 0.19)
    assert x[:, 2].max() == pytest.approx(-0.205 + 0.21)
    assert x[:, 0].max() == pytest.approx(0.6)
    forces = np.random.default_rng(0).normal(size=x.shape)
    forces[:, 1] = 0.0
    load = skin.load(c, forces)
    np.testing.assert_allclose(load.sum(axis=0)[[0, 1]], forces.sum(axis=0)[[0, 2]])
    moment = np.sum(x[:, 0] * forces[:, 2] - x[:, 2] * forces[:, 0])
    y = body.x - np.array([0.0, 0.205, 0.0])
    assert np.sum(y[:, 0] * load[:, 1] - y[:, 1] * load[:, 0]) == pytest.approx(moment)


def test_flag_cylinder_and_channel_are_walls_the_fluid_moves(body):
    walls = flag_in_channel(body, 1.0, 0.02)
    assert isinstance(walls, Compliant)
    assert isinstance(walls, Solid)
    assert walls.panel_names == ("below", "end", "above", "cylinder", "floor", "ceiling")
    assert walls.triangles.max() == len(walls.state(0.0).x) - 1
    places = np.array([[0.2, 0.0, 0.0], [0.4, 0.0, -0.005], [0.4, 0.0, 0.1], [0.4, 0.0, 0.3]])
    assert walls.holds(places).tolist() == [True, True, False, True]


def test_inflow_is_a_parabola_of_mean_one_once_it_has_risen():
    z = np.linspace(-0.205, 0.205, 2001)
    assert np.trapezoid(Inflow(1.8).speed(z, 5.0), z) / 0.41 == pytest.approx(1.0, rel=1e-5)
    assert Inflow(1.8).speed(z, 0.0).max() == 0.0


def test_frequency_of_a_signal_off_its_middle():
    t = np.linspace(0.0, 3.0, 1000)
    assert frequency(t, 3.0 + np.sin(2.0 * np.pi * 2.3 * t)) == pytest.approx(2.3, rel=1e-3)
    assert frequency(t, t) == 0.0
