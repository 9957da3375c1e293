# SPDX-License-Identifier: Apache-2.0
"""Planform, mesh and the place of the wings in the wind."""

import math

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_sim.kinematics import Kinematics
from cwmav_sim.wing.geometry import WingPlanform, mesh_panel
from cwmav_sim.wing.prescribed import Attitude, ClappingWings
from cwmav_sim.wing.sheet import SheetMotion, triangle_areas

PLANFORM = WingPlanform()


def wings(half=True, aoa_deg=15.0, frequency=16.0, airspeed=3.5, spacing=0.012, **kinematics):
    attitude = Attitude(frequency, math.radians(aoa_deg), airspeed)
    return ClappingWings(PLANFORM, Kinematics(**kinematics), attitude, spacing=spacing, half=half)


def test_area_is_that_of_the_reference_panel():
    assert PLANFORM.area == pytest.approx(0.00956, rel=0.012)


@pytest.mark.parametrize("spacing", [0.012, 0.004, 0.002])
def test_mesh_covers_the_planform(spacing):
    mesh = mesh_panel(PLANFORM, spacing)
    nodes = np.column_stack([mesh.r, mesh.s, np.zeros_like(mesh.r)])
    areas = triangle_areas(nodes, mesh.triangles)
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(PLANFORM.area, rel=0.6 * spacing / 0.04)
    assert np.all(mesh.s <= PLANFORM.chord(mesh.r) + 1e-12)
    sides = nodes[mesh.triangles]
    normals = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])[:, 2]
    assert np.all(normals > 0), "all triangles turn the same way"


def test_every_mesh_node_is_used_and_edges_are_shared_by_two_at_most():
    mesh = mesh_panel(PLANFORM, 0.008)
    assert set(mesh.triangles.ravel()) == set(range(len(mesh.r)))
    edges = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert counts.max() == 2


def test_planform_order_is_checked():
    with pytest.raises(InputError, match=r"root 0\.11 m"):
        WingPlanform(root=0.11)


def test_it_is_a_sheet_motion():
    assert isinstance(wings(), SheetMotion)


def test_half_model_is_the_right_half_of_the_full_one():
    half, full = wings(half=True), wings(half=False)
    t = 0.0713
    a, b = half.state(t), full.state(t)
    n = len(a.x)
    np.testing.assert_array_equal(a.x, b.x[:n])
    mirror = np.array([1.0, -1.0, 1.0])
    for name in ("x", "v", "a"):
        np.testing.assert_allclose(getattr(b, name)[n:], getattr(b, name)[:n] * mirror, atol=1e-9)
    assert half.panel_names == full.panel_names[:2]
    assert len(full.triangles) == 2 * len(half.triangles)
    assert full.triangles.max() == len(b.x) - 1


def test_upper_and_lower_wing_mirror_each_other_without_dihedral():
    state = wings(aoa_deg=0.0, dihedral_deg=0.0).state(0.09)
    upper, lower = np.split(state.x, 2)
    np.testing.assert_allclose(lower, upper * [1.0, 1.0, -1.0], atol=1e-12)


def test_angle_of_attack_turns_the_body_nose_up():
    level = wings(aoa_deg=0.0, airspeed=0.0).state(0.1).x
    pitched = wings(aoa_deg=90.0 - 1e-9, airspeed=0.0).state(0.1).x
    # A node behind the leading edge (+x) hangs below (-z) when the nose points up.
    np.testing.assert_allclose(pitched[:, 2], -level[:, 0], atol=1e-9)
    np.testing.assert_allclose(pitched[:, 0], level[:, 2], atol=1e-9)


def test_span_is_the_published_one():
    state = wings(dihedral_deg=0.0, opening_deg=1e-3, clap_half_gap_deg=1e-3).state(0.0)
    assert 2 * state.x[:, 1].max() == pytest.approx(0.280, rel=1e-6)


@pytest.mark.parametrize(("frequency", "airspeed"), [(4.0, 6.0), (16.0, 3.5), (30.0, 0.0)])
def test_wings_never_cross_the_clap_plane(frequency, airspeed):
    gap = math.radians(2.5)
    motion = wings(
        aoa_deg=0.0, dihedral_deg=0.0, frequency=frequency, airspeed=airspeed, clap_half_gap_deg=2.5
    )
    mesh = mesh_panel(PLANFORM, 0.012)
    lowest = np.inf
    for phase in np.linspace(1.0, 2.0, 101):
        upper = np.split(motion.state(phase / frequency).x, 2)[0]
        lowest = min(lowest, float((upper[:, 2] / mesh.r).min()))
    assert lowest > 0.35 * gap, "trailing edges keep near half of the clap half gap"


def test_leading_edge_stays_straight_and_moves_with_the_stroke():
    motion = wings(aoa_deg=0.0)
    mesh = mesh_panel(PLANFORM, 0.012)
    state = motion.state(0.08)
    edge = mesh.s == 0.0
    upper = np.split(state.x, 2)[0][edge]
    angle = np.arctan2(upper[:, 2], upper[:, 1])
    np.testing.assert_allclose(angle, angle[0], atol=1e-12)
    np.testing.assert_allclose(np.hypot(upper[:, 1], upper[:, 2]), mesh.r[edge], rtol=1e-12)
