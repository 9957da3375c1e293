# SPDX-License-Identifier: Apache-2.0
"""The quasi-flexible wing: facets, joints, loads that conserve force, moment and work, stability."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cwmav_sim.kinematics import Kinematics
from cwmav_sim.wing.facets import group_triangles, rigid_facets
from cwmav_sim.wing.film_mesh import even_mesh
from cwmav_sim.wing.flexible import Flexibility, LatticeLayout, membrane_wings, plan
from cwmav_sim.wing.geometry import WingPlanform
from cwmav_sim.wing.lattice import lattice_panel, lattice_wings
from cwmav_sim.wing.prescribed import Attitude
from cwmav_sim.wing.rotation import exponential


def layout(**settings):
    return plan(
        Flexibility(lattice=LatticeLayout(spanwise=4, chordwise=3), **settings),
        WingPlanform(),
        Kinematics(),
        Attitude(12.0, 0.2, 3.0),
        spacing=0.018,
        half=True,
    )


def swung(structure, steps=40, step=2e-4):
    for _ in range(steps):
        state = structure.state()
        structure.advance(structure.time + step, -0.05 * state.v / len(state.v))
    return structure


def test_facets_have_the_mass_and_inertia_of_a_plate():
    rng = np.random.default_rng(1)
    points = rng.random((50, 3)) * [2.0, 1.0, 0.0]
    mass = rng.random(50)
    facets = rigid_facets(np.zeros(3, dtype=np.int64), points, mass, np.zeros(50, dtype=np.int64))
    assert facets.mass[0] == pytest.approx(mass.sum())
    assert_allclose(facets.centre[0], mass @ points / mass.sum())
    assert facets.inertia[0].max() == pytest.approx(facets.inertia[0].sum() / 2)  # flat: J3 = J1 + J2
    assert np.linalg.det(facets.axes[0]) == pytest.approx(1.0)


def test_grouping_covers_every_triangle_without_gaps():
    mesh = even_mesh(WingPlanform(), 0.01)
    number = group_triangles(mesh, WingPlanform(), 5, 4)
    assert len(number) == len(mesh.triangles)
    assert set(number) == set(range(number.max() + 1))
    assert number.max() + 1 == 20


def test_same_mass_as_the_film_wing_and_same_flat_shape():
    design = layout()
    lattice, film = lattice_wings(design), membrane_wings(design)
    assert lattice.system.inertia.mass.sum() == pytest.approx(film.system.inertia.mass.sum(), rel=1e-4)
    assert_allclose(lattice.state().x, film.state().x, atol=1e-12)
    assert_allclose(lattice.energies.elastic, 0.0, atol=1e-18)


def test_no_facet_hangs_on_fewer_than_three_joints():
    facets, grounds, joints = lattice_panel(layout())
    near = {k: set() for k in range(len(facets.mass) + len(grounds))}
    for joint in joints:
        near[joint.first].add(joint.second)
        near[joint.second].add(joint.first)
    clamped = near[len(facets.mass)]
    assert all(len(near[k]) >= 3 or k in clamped for k in range(len(facets.mass)))


def test_loads_conserve_force_moment_and_power():
    structure = swung(lattice_wings(layout()))
    c = structure.save().configuration
    rng = np.random.default_rng(2)
    state = structure.state()
    force = rng.normal(size=state.x.shape)
    on_bodies = structure.sheet.load(c, force)
    n = structure.system.nodes
    assert_allclose(on_bodies[:n].sum(axis=0), force.sum(axis=0), atol=1e-12)
    moment = np.cross(c.x, on_bodies[:n]).sum(axis=0) + on_bodies[n:].sum(axis=0)
    assert_allclose(moment, np.cross(state.x, force).sum(axis=0), atol=1e-5)
    assert np.sum(on_bodies * c.rates) == pytest.approx(np.sum(force * state.v), rel=1e-12)


def test_compliance_is_what_impulses_do_to_the_sheet():
    structure = swung(lattice_wings(layout()), steps=5)
    motion = structure.save()
    c = motion.configuration
    impulse = np.random.default_rng(3).normal(size=structure.state().x.shape)
    change = structure.sheet.kick(c, impulse)
    n = structure.system.nodes
    kicked = type(c)(c.x, c.v + change[:n], c.turn, c.spin + change[n:])
    before = structure.sheet.state(c, motion.acceleration).v
    after = structure.sheet.state(kicked, motion.acceleration).v
    predicted = structure.sheet.compliance(c) @ impulse.ravel()
    assert_allclose((after - before).ravel(), predicted, rtol=1e-8, atol=1e-8 * np.abs(predicted).max())


def test_flapping_is_stable_and_keeps_its_energy_account():
    structure = swung(lattice_wings(layout()))
    e = structure.energies
    assert e.drive_work > 0
    assert abs(e.numerical) < 0.02 * e.drive_work
    facets, _, joints = lattice_panel(layout())
    parts = structure.system.elements[0]
    c = structure.save().configuration
    gap = np.linalg.norm(
        c.x[parts.second.body]
        + np.einsum("mij,mj->mi", c.turn[parts.second.body], parts.second.arm)
        - c.x[parts.first.body]
        - np.einsum("mij,mj->mi", c.turn[parts.first.body], parts.first.arm),
        axis=1,
    )
    assert len(gap) == 2 * len(joints)
    assert gap.max() < 2e-4
    assert len(facets.mass) >= 8


def test_rigid_rotation_of_the_whole_lattice_stores_nothing():
    structure = lattice_wings(layout())
    c = structure.save().configuration
    rotation = exponential(np.array([0.4, -0.2, 0.9]))
    turned = type(c)(c.x @ rotation.T, 0 * c.v, rotation @ c.turn, 0 * c.spin)
    stretched = type(c)(1.001 * c.x, 0 * c.v, c.turn, 0 * c.spin)
    assert structure.system.elastic(turned) < 1e-12 * structure.system.elastic(stretched)
