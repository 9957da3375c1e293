# SPDX-License-Identifier: Apache-2.0
"""Flexible wings in motion: hinges, energy account, loads, protocol, restart."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cwmav_common.errors import InputError, WorkError
from cwmav_sim.kinematics import Kinematics
from cwmav_sim.wing.flexible import Flexibility, Root, membrane_wings, plan
from cwmav_sim.wing.geometry import WingPlanform
from cwmav_sim.wing.integrate import Integration
from cwmav_sim.wing.prescribed import Attitude, ClappingWings
from cwmav_sim.wing.sheet import triangle_areas

ATTITUDE = Attitude(frequency=12.0, angle_of_attack=0.3, airspeed=3.0)
SPACING = 0.02


def layout(*, half=True, moving=True, **settings):
    return plan(
        Flexibility(**settings),
        WingPlanform(),
        Kinematics(),
        ATTITUDE,
        spacing=SPACING,
        half=half,
        moving=moving,
    )


def wings(**kwargs):
    return membrane_wings(layout(**kwargs))


def no_load(structure):
    return np.zeros_like(structure.state().x)


def drag(structure, strength=0.05):
    """Return a load against the motion, like thin air [N]."""
    return -strength * structure.state().v / len(structure.state().x)


def swing(structure, steps=60, step=2e-4):
    for _ in range(steps):
        structure.advance(structure.time + step, drag(structure))
    return structure


def test_hinges_move_as_the_prescribed_wing():
    design = layout(half=False)
    rigid = ClappingWings(
        WingPlanform(), Kinematics(twist_fraction=0.0), ATTITUDE, spacing=SPACING, half=False
    )
    mesh = rigid._mesh
    flat = np.stack([mesh.r, mesh.s, np.zeros(len(mesh.r))], axis=1)
    assert tuple(p.name for p in design.panels) == rigid.panel_names
    for t in (0.0, 0.013, 0.05, 0.11):
        frames, state = design.hinges.at(t), rigid.state(t)
        x = np.concatenate([flat @ axes.T for axes in frames.axes])
        group = np.repeat(np.arange(4), len(flat))
        spin, rate = frames.spin[group], frames.spin_rate[group]
        v = np.cross(spin, x)
        assert_allclose(x, state.x, atol=1e-15)
        assert_allclose(v, state.v, atol=1e-12)
        assert_allclose(np.cross(rate, x) + np.cross(spin, v), state.a, atol=1e-9)


def test_unloaded_wing_is_flat_full_size_and_weighs_what_its_parts_do():
    design = layout()
    structure = membrane_wings(design)
    areas = triangle_areas(structure.state().x, structure.triangles)
    assert areas.sum() == pytest.approx(2 * WingPlanform().area, rel=0.01)
    assert structure.energies.elastic == pytest.approx(0.0, abs=1e-20)
    film = design.flexibility.film
    rods = [design.flexibility.spar.section().line_mass * 0.12]
    parts = areas.sum() / 2 * film.thickness * film.density + sum(rods)
    assert structure.system.inertia.mass.sum() / 2 == pytest.approx(parts + 18e-6, rel=0.03)


def test_energy_account_closes_while_flapping():
    structure = swing(wings())
    e = structure.energies
    assert e.kinetic > 1e-6
    assert e.drive_work > 0
    assert e.load_work < 0
    assert e.dissipated > 0
    assert abs(e.numerical) < 0.01 * e.drive_work


def test_driven_root_follows_the_law_and_the_body_corner_stays():
    structure = swing(wings())
    held = structure.system.drive.nodes.reshape(2, 2)
    state, start = structure.state(), wings().state()
    law = structure.system.drive.at(structure.time)
    assert_allclose(state.x[held.ravel()], law.x, atol=1e-15)
    assert_allclose(state.x[held[:, 1]], start.x[held[:, 1]], atol=1e-15)
    assert np.linalg.norm(state.x[held[:, 0]] - start.x[held[:, 0]], axis=1).min() > 1e-4


def test_upper_and_lower_wing_move_as_mirror_images_without_dihedral():
    design = plan(
        Flexibility(),
        WingPlanform(),
        Kinematics(dihedral_deg=0.0),
        Attitude(12.0, 0.0, 3.0),
        spacing=SPACING,
        half=True,
    )
    state = swing(membrane_wings(design)).state()
    upper, lower = np.split(state.x, 2)
    assert_allclose(upper * [1, 1, -1], lower, atol=1e-7)


def test_free_trailing_edge_corner_swings():
    structure = swing(wings(root=Root(trailing_edge="free")))
    assert len(structure.system.drive.nodes) == 2


def test_restart_repeats_bit_for_bit():
    first = swing(wings(), steps=10)
    saved = first.save()
    uninterrupted = swing(first, steps=5).state()
    first.restore(saved)
    assert first.time == saved.time
    one = swing(first, steps=5).state()
    second = wings()
    second.restore(saved)
    two = swing(second, steps=5).state()
    assert np.array_equal(two.x, one.x)
    assert np.array_equal(two.a, one.a)
    assert_allclose(two.x, uninterrupted.x, rtol=0, atol=1e-8)


def test_static_load_work_becomes_elastic_energy_and_damping():
    structure = wings(moving=False)
    load = no_load(structure)
    load[:, 2] = 2e-5
    for _ in range(120):
        structure.advance(structure.time + 5e-4, load)
    e = structure.energies
    assert e.load_work > 0
    assert e.drive_work == pytest.approx(0.0, abs=1e-12)
    assert abs(e.numerical) < 0.05 * e.load_work
    assert e.elastic + e.dissipated + e.kinetic == pytest.approx(e.load_work - e.numerical, rel=1e-9)


def test_bad_loads_are_refused():
    structure = wings()
    load = no_load(structure)
    with pytest.raises(InputError, match="shape"):
        structure.advance(1e-4, load[:-1])
    with pytest.raises(WorkError, match="not finite"):
        structure.advance(1e-4, load + np.nan)
    structure.advance(1e-4, load)
    with pytest.raises(InputError, match="before the time reached"):
        structure.advance(0.5e-4, load)


def test_hopeless_load_says_when_and_how_small_a_step_failed():
    structure = wings(integration=Integration(iterations=2, halvings=1, tolerance=1e-12))
    load = no_load(structure)
    load[::7, 2] = 50.0
    with pytest.raises(WorkError, match="no equilibrium at t ="):
        structure.advance(4e-4, load)


def test_settings_refuse_a_stiffener_off_the_film():
    from cwmav_sim.wing.rods import Stiffener

    with pytest.raises(InputError, match="no length on film"):
        wings(stiffeners=(Stiffener(0.05, 0.0, 0.10, 0.5),))
