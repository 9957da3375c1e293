# SPDX-License-Identifier: Apache-2.0
"""The particle air against exact solutions, in seconds; the full cases are those of `cwmav-sim verify`."""

from dataclasses import replace

import numpy as np
import pytest

from cwmav_sim.solver import Solver
from cwmav_sim.sph.timestep import stable_step
from cwmav_sim.verification.added_mass import AddedMass
from cwmav_sim.verification.catalogue import catalogue
from cwmav_sim.verification.cavity import LidDrivenCavity
from cwmav_sim.verification.channel import Couette, Poiseuille
from cwmav_sim.verification.clap_fling import ClapAndFling, _fling
from cwmav_sim.verification.convergence import observed_order
from cwmav_sim.verification.cylinder import OscillatingCylinder, StartedCylinder
from cwmav_sim.verification.flows import HeldVolume, History, at_places, plane_flow
from cwmav_sim.verification.hover import HoveringEllipse
from cwmav_sim.verification.hydrostatic import HydrostaticColumn
from cwmav_sim.verification.outlines import Chain, Pose, circle, half_ellipse, line, outlines
from cwmav_sim.verification.taira import LowAspectRatioPlate
from cwmav_sim.verification.taylor_green import TaylorGreen


@pytest.mark.parametrize(
    "case",
    [
        Couette(cells=16, times=(0.1, 0.3)),
        Poiseuille(cells=16, times=(0.1, 0.3)),
        TaylorGreen(cells=40, duration=0.5),
    ],
    ids=lambda case: case.name,
)
def test_case_passes(case):
    checks = case.run()
    assert len(checks) >= 3
    assert [(c.quantity, c.value, c.reference) for c in checks if not c.passed] == []


def test_a_coarse_column_rests_on_its_floor():
    checks = {c.quantity: c for c in HydrostaticColumn(cells=16, duration=6.0).run()}
    assert checks["force on floor and ceiling [weight]"].passed
    assert checks["rms error of pressure over rho g H"].value < 0.02
    assert checks["highest speed [c0]"].value < 2e-3


def test_a_closed_vessel_holds_the_volume_of_its_air():
    flow = plane_flow(0.1, 1.0, 1.0, viscosity=0.01, sound_speed=10.0)
    solver = Solver(flow, None, 0.0, highest_speed=1.0)
    before = solver.density.copy()
    held = HeldVolume(solver)
    solver.density[:] *= np.linspace(1.0, 1.02, solver.particles)
    info = solver.step()
    stepped = solver.density.copy()
    held(info)
    assert np.sum(1.0 / solver.density) == pytest.approx(np.sum(1.0 / before), rel=1e-12)
    assert np.ptp(solver.density / stepped) < 1e-14  # all alike, so pressure differences stay


def test_a_wrong_viscosity_fails_the_bar(monkeypatch):
    module = "cwmav_sim.verification.channel.plane_flow"
    monkeypatch.setattr(module, lambda *a, **k: plane_flow(*a, **(k | {"viscosity": 1.2})))
    assert not all(c.passed for c in Couette(cells=16, times=(0.1,)).run())


def test_names_of_cases_are_unique():
    names = [c.name for c in catalogue()]
    assert len(set(names)) == len(names)


def test_a_moving_body_keeps_the_air_out_and_its_force_balances():
    dp, rim = 0.1, 0.5
    speed = np.array([1.0, 0.5])
    body = outlines(
        [Chain("cylinder", circle(rim, dp), lambda t: Pose(speed * t, speed, np.zeros(2)))],
        dp,
        lambda x: np.hypot(x[:, 0], x[:, 2]) < rim,
    )
    flow = plane_flow(dp, 4.0, 4.0, upstream=2.0, viscosity=0.02, sound_speed=10.0)
    solver = Solver(flow, body, 0.0, highest_speed=1.0)
    assert solver.particles == pytest.approx(1600 - np.pi * rim**2 / dp**2, abs=4)
    history = History(solver)
    history.until(0.3)
    assert history.balance("body").passed
    place = solver.position[:, [0, 2]] - speed * solver.time
    assert np.hypot(*place.T).min() > rim
    assert solver.crossings == 0
    _, force = history.forces()
    assert (force.mean(axis=0) < 0.0).all()


def test_air_on_both_sides_of_a_thin_body_stays_there():
    dp = 0.05
    chains = [Chain(n, half_ellipse(1.0, 0.1, s, dp)) for n, s in (("upper", 1.0), ("lower", -1.0))]
    body = outlines(chains, dp, lambda x: (x[:, 0] / 0.5) ** 2 + (x[:, 2] / 0.05) ** 2 < 1.0)
    flow = plane_flow(dp, 3.0, 3.0, upstream=1.5, viscosity=0.01, sound_speed=10.0, set_back=0.0)
    solver = Solver(flow, body, 0.0, highest_speed=1.0)
    # Pressure above, none below: only the rim may leak.
    high = (
        (solver.position[:, 2] > 0.0) & (np.abs(solver.position[:, 0]) < 0.3) & (solver.position[:, 2] < 0.2)
    )
    solver.set_pressure(np.where(high, 1.0, 0.0))
    info = solver.step()
    assert info.pressure[0, 2] < -0.4
    assert abs(info.pressure[1, 2]) < 0.02


def test_gravity_reaches_every_particle_and_is_accounted_for():
    flow = plane_flow(0.1, 1.5, 1.5, viscosity=0.01, sound_speed=10.0, gravity=2.0)
    solver = Solver(flow, None, 0.0, highest_speed=1.0)
    history = History(solver)
    history.until(0.05)
    assert solver.velocity[:, 2].mean() == pytest.approx(-2.0 * solver.time)
    assert history.balance("fall").value < 1e-12


def test_a_zone_around_quiets_both_pairs_of_faces():
    flow = plane_flow(0.1, 3.0, 3.0, viscosity=0.0, sound_speed=10.0, upstream=1.5)
    flow = replace(flow, fringe=replace(flow.fringe, width=1.0, rate=50.0, around=True))
    solver = Solver(flow, None, 0.0, highest_speed=1.0)
    solver.velocity[:, 0] = 1.0
    for _ in range(10):
        solver.step()
    x, z = solver.position[:, 0], solver.position[:, 2]
    middle = (np.abs(z) < 0.5) & (x < 0.0)
    edge = (np.abs(z) > 1.4) | (np.abs(x - 1.0) < 0.1)
    assert np.abs(solver.velocity[edge]).max() < 0.5
    assert solver.velocity[middle, 0].mean() > 0.9


def test_velocities_at_places_are_exact_for_a_linear_field():
    flow = plane_flow(0.1, 2.0, 2.0, viscosity=0.0, sound_speed=10.0, jitter=0.2)
    solver = Solver(flow, None, 0.0, highest_speed=1.0)
    solver.velocity[:, 0] = 1.0 + 2.0 * solver.position[:, 0] - solver.position[:, 2]
    places = np.array([[0.63, 0.11], [1.2, -0.4]])
    found = at_places(solver, places, 0.17)[:, 0]
    np.testing.assert_allclose(found, 1.0 + 2.0 * places[:, 0] - places[:, 1], atol=1e-12)


def test_walls_that_reach_periodic_faces_have_no_edge_there():
    dp = 0.1
    wall = outlines([Chain("wall", line((0.0, 0.0), (2.0, 0.0)))], dp)
    flow = plane_flow(dp, 2.0, 2.0, viscosity=0.0, sound_speed=10.0)
    solver = Solver(flow, wall, 0.0, highest_speed=1.0)
    solver.set_pressure(np.where(solver.position[:, 2] > 0.0, 1.0, 0.0))
    assert solver.step().pressure[0, 2] == pytest.approx(-2.0, rel=0.1)  # along the whole length


def test_viscous_limit_of_the_step_rules_only_where_it_must():
    assert stable_step(0.2, 0.0068, 60.0, 0.0, 1.48e-5) == stable_step(0.2, 0.0068, 60.0, 0.0)
    assert stable_step(0.4, 0.1, 10.0, 0.0, 1.0) == pytest.approx(0.125 * 0.01)


def test_observed_order_of_errors_that_fall_with_the_square():
    assert observed_order((10, 20, 40), (0.4, 0.1, 0.025)) == pytest.approx(2.0)


@pytest.mark.parametrize(
    "case",
    [
        LidDrivenCavity(100, 3.0, duration=0.2, cells=12),
        LowAspectRatioPlate(30, cells=4, duration=0.4),
        AddedMass("small", aspect_ratio=1.0, coefficient=0.579, cells=4),
        pytest.param(StartedCylinder(40, 3, length=14.0, height=14.0), marks=pytest.mark.slow),
        pytest.param(OscillatingCylinder(cells=6, side=6.0), marks=pytest.mark.slow),
        pytest.param(HoveringEllipse(cells=6, cycles=1, side=5.0), marks=pytest.mark.slow),
        pytest.param(ClapAndFling(32, cells=6, length=8.0, height=5.0), marks=pytest.mark.slow),
    ],
    ids=lambda case: case.name,
)
def test_a_long_case_runs_in_small_and_balances(case):
    checks = case.run()
    assert all(np.isfinite(c.value) for c in checks)
    assert checks[-1].quantity.startswith("momentum")
    assert checks[-1].passed


def test_a_fling_ends_at_half_a_right_angle_and_full_speed():
    for side in (1.0, -1.0):
        start, end = _fling(0.0, side), _fling(5.0, side)
        assert start.angle == 0.0
        assert end.angle == pytest.approx(-side * np.pi / 4)
        np.testing.assert_allclose(end.speed, [side, 0.0])
        t = np.linspace(0.0, 3.0, 20001)
        way = [_fling(s, side).place[0] for s in t]
        speed = np.array([_fling(s, side).speed[0] for s in t])
        np.testing.assert_allclose(np.gradient(way, t), speed, atol=1e-3)
        rate = np.array([_fling(s, side).rate for s in t])
        np.testing.assert_allclose(np.gradient([_fling(s, side).angle for s in t], t), rate, atol=1e-3)
