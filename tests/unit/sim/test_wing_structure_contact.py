# SPDX-License-Identifier: Apache-2.0
"""Contact of the wings of a pair: detection, laws of impact and friction, conservation."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cwmav_sim.wing.contact import ContactLaw, Impacts
from cwmav_sim.wing.drive import StillRoot
from cwmav_sim.wing.dynamics import System
from cwmav_sim.wing.integrate import Integration, Integrator
from cwmav_sim.wing.parts import Configuration, Inertia
from cwmav_sim.wing.sheet_map import NodesAreSheet

NO_BODIES, NO_SPIN = np.zeros((0, 3, 3)), np.zeros((0, 3))
NONE = np.zeros(0, dtype=np.int64)
NAMES = ("upper_right", "lower_right")
TRIANGLES = np.array([[0, 1, 2], [3, 4, 5]])
PANEL = np.array([0, 1])


class TwoTriangles:
    """A light upper triangle over a heavier lower one; nothing else acts."""

    def __init__(self, height, velocity, *, held=NONE, start_height=1.0, **law):
        lower = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        upper = np.array([[0.2, 0.2, 0.0], [0.6, 0.2, 0.5], [0.2, 0.6, 0.5]])  # touches with one corner
        self.start = np.concatenate([upper + np.array([0, 0, start_height]), lower])
        x = np.concatenate([upper + np.array([0, 0, height]), lower])
        v = np.concatenate([np.tile(velocity, (3, 1)), np.zeros((3, 3))]).astype(float)
        mass = np.array([1.0, 1.0, 1.0, 3.0, 3.0, 3.0])
        self.system = System(
            Inertia(mass, NO_SPIN), [], StillRoot(x, NO_BODIES, np.asarray(held, dtype=np.int64), NONE)
        )
        self.impacts = Impacts(
            ContactLaw(separation=0.0, **law),
            self.system,
            NodesAreSheet(self.system),
            TRIANGLES,
            PANEL,
            NAMES,
            self.start,
        )
        self.motion = Integrator(self.system, Integration(), x, NO_BODIES, v=v).motion

    def after(self):
        return self.impacts.resolve(self.motion)


def normal_speed(motion):
    c = motion.configuration
    return c.v[0, 2] - (np.array([0.6, 0.2, 0.2]) @ c.v[3:, 2])


def test_apart_or_separating_wings_are_left_alone():
    apart = TwoTriangles(0.1, [0, 0, -1])
    assert apart.after() is apart.motion
    leaving = TwoTriangles(1e-4, [0, 0, 1])
    assert_allclose(leaving.after().configuration.v, leaving.motion.configuration.v)


@pytest.mark.parametrize("restitution", [0.0, 0.001, 0.5, 1.0])
def test_restitution_is_newtons(restitution):
    pair = TwoTriangles(1e-4, [0, 0, -2], restitution=restitution)
    assert normal_speed(pair.after()) == pytest.approx(2 * restitution, abs=1e-5)


def test_elastic_impact_keeps_energy_and_plastic_loses_it():
    elastic = TwoTriangles(1e-4, [0, 0, -2], restitution=1.0, friction=0.0)
    assert elastic.after().energies.contact == pytest.approx(0.0, abs=1e-5)
    plastic = TwoTriangles(1e-4, [0, 0, -2], restitution=0.0).after().energies
    assert plastic.contact > 0.1
    assert plastic.kinetic + plastic.contact == pytest.approx(plastic.initial)


def test_momentum_is_conserved():
    pair = TwoTriangles(1e-4, [3, 1, -2])
    mass = pair.system.inertia.mass[:, None]
    before, after = pair.motion.configuration, pair.after().configuration
    assert_allclose((mass * after.v).sum(axis=0), (mass * before.v).sum(axis=0), atol=1e-12)
    spin = [np.cross(c.x, mass * c.v).sum(axis=0) for c in (before, after)]
    assert_allclose(spin[1], spin[0], atol=1e-3)  # friction acts across the contact distance


@pytest.mark.parametrize(("slide", "sticks"), [(0.3, True), (5.0, False)])
def test_friction_sticks_below_the_cone_and_slides_above(slide, sticks):
    pair = TwoTriangles(1e-4, [slide, 0, -2], friction=0.45, held=[3, 4, 5])
    change = pair.after().configuration.v[0] - pair.motion.configuration.v[0]
    if sticks:
        assert pair.after().configuration.v[0, 0] == pytest.approx(0.0, abs=1e-4)
        assert abs(change[0]) < 0.45 * change[2]
    else:
        assert change[0] == pytest.approx(-0.45 * change[2], rel=1e-4)


def test_a_node_that_has_passed_through_is_pushed_back_to_its_side():
    pair = TwoTriangles(-5e-4, [0, 0, -1])
    pair.impacts.law = dataclasses.replace(pair.impacts.law, separation=0.2)
    contacts = pair.impacts.find(pair.motion.configuration.x)
    assert contacts.gap[contacts.node == 0] == pytest.approx(-5e-4)
    assert normal_speed(pair.after()) > 0.0


def test_which_side_is_above_comes_from_the_start_not_from_the_winding():
    flipped = np.array([[0, 1, 2], [3, 5, 4]])
    pair = TwoTriangles(1e-4, [0, 0, -2])
    other = Impacts(ContactLaw(), pair.system, NodesAreSheet(pair.system), flipped, PANEL, NAMES, pair.start)
    here = pair.impacts.find(pair.motion.configuration.x)
    there = other.find(pair.motion.configuration.x)
    assert_allclose(here.normal, there.normal)
    assert_allclose(here.gap, there.gap)


def test_wings_of_different_sides_never_touch():
    pair = TwoTriangles(1e-4, [0, 0, -2])
    names = ("upper_right", "lower_left")
    alone = Impacts(
        ContactLaw(), pair.system, NodesAreSheet(pair.system), TRIANGLES, PANEL, names, pair.start
    )
    assert alone.resolve(pair.motion) is pair.motion


def test_configuration_is_not_changed_in_place():
    pair = TwoTriangles(1e-4, [0, 0, -2])
    before = pair.motion.configuration.v.copy()
    pair.after()
    assert np.array_equal(pair.motion.configuration.v, before)
    assert isinstance(pair.motion.configuration, Configuration)
