# SPDX-License-Identifier: Apache-2.0
"""The time loop: what must hold whatever the flow is."""

from dataclasses import replace

import numpy as np
import pytest

from cwmav_common.errors import InputError, WorkError
from cwmav_sim.solver import Solver
from cwmav_sim.sph.settings import Box, FlowSettings, Fluid, Fringe, Resolution, Shifting
from cwmav_sim.verification.plates import FixedPlate, OscillatingPlate

DP = 0.0125
BOX = Box(length=0.2, width=0.2, height=0.2, upstream=0.1, symmetric=False)
CALM = FlowSettings(
    fluid=Fluid(sound_speed=20.0),
    resolution=Resolution(dp=DP, cfl=0.4, precision="double", jitter=0.0),
    box=BOX,
    fringe=Fringe(width=0.0),
)
MOVING = OscillatingPlate(chord=0.05, span=0.05, spacing=DP, amplitude=0.01, frequency=8.0)
RESTING = replace(MOVING, amplitude=0.0)


def run(settings, motion, steps, airspeed=0.0, **options):
    solver = Solver(settings, motion, airspeed, **options)
    infos = [solver.step() for _ in range(steps)]
    return solver, infos


def _steps(solver, count):
    for _ in range(count):
        solver.step()


def force(infos):
    return np.array([(info.pressure + info.viscous).sum(axis=0) for info in infos])


def test_air_at_rest_around_a_resting_wall_stays_at_rest_exactly():
    solver, infos = run(replace(CALM, shifting=Shifting(coefficient=0.0)), RESTING, 5)
    assert np.array_equal(solver.velocity, np.zeros_like(solver.velocity))
    assert np.array_equal(force(infos), np.zeros((5, 3)))


def test_a_uniform_stream_without_walls_stays_uniform():
    solver, _ = run(replace(CALM, fringe=Fringe(width=0.06)), None, 10, airspeed=3.0)
    np.testing.assert_allclose(solver.velocity, [[3.0, 0.0, 0.0]] * solver.particles, atol=1e-10)
    np.testing.assert_allclose(solver.density, 1.225, rtol=1e-12)


def test_momentum_given_to_the_air_equals_the_force_on_the_wall():
    solver, _ = run(CALM, MOVING, 20)
    scale = np.linalg.norm(solver.wall_impulse)
    assert scale > 1e-5
    np.testing.assert_allclose(solver.momentum(), -solver.wall_impulse, atol=1e-9 * scale)


def test_momentum_balance_includes_the_fringe():
    settings = replace(CALM, fringe=Fringe(width=0.05, rate=200.0))
    solver, _ = run(settings, MOVING, 15, airspeed=2.0)
    start = np.array([2.0, 0.0, 0.0]) * 1.225 * 0.2**3
    gained = solver.momentum() - start
    scale = np.linalg.norm(solver.wall_impulse)
    np.testing.assert_allclose(gained, solver.fringe_impulse - solver.wall_impulse, atol=1e-9 * scale)


def test_power_given_to_the_air_is_force_times_speed_of_a_rigid_plate():
    solver = Solver(CALM, MOVING, 0.0)
    for _ in range(6):
        begin = solver.time
        info = solver.step()
        speed = MOVING.speed(begin + 0.5 * info.dt)
        work = -float((info.pressure + info.viscous)[0, 2]) * speed
        assert float(info.power[0]) == pytest.approx(work, rel=1e-9, abs=1e-12)


def test_the_same_settings_give_the_same_bits():
    single = replace(CALM, resolution=replace(CALM.resolution, precision="single", jitter=0.05))
    first, infos = run(single, MOVING, 8)
    second, again = run(single, MOVING, 8)
    assert np.array_equal(first.position, second.position)
    assert np.array_equal(force(infos), force(again))


def test_single_and_double_precision_agree():
    # On a perfect lattice particles are equally far from two edges, and rounding would choose between them.
    double = replace(CALM, resolution=replace(CALM.resolution, jitter=0.05))
    _, coarse = run(replace(double, resolution=replace(double.resolution, precision="single")), MOVING, 10)
    _, fine = run(double, MOVING, 10)
    np.testing.assert_allclose(force(coarse), force(fine), atol=1e-3 * np.abs(force(fine)).max())


def test_a_common_velocity_changes_nothing():
    still = replace(CALM, shifting=Shifting(coefficient=0.0))
    drifting_plate = _Drifting(MOVING, 2.0)
    options = {"highest_speed": 3.0}
    _, at_rest = run(still, MOVING, 12, **options)
    _, drifting = run(still, drifting_plate, 12, airspeed=2.0, **options)
    np.testing.assert_allclose(
        force(drifting)[:, 2], force(at_rest)[:, 2], atol=0.02 * np.abs(force(at_rest)).max()
    )


def test_half_a_model_gives_half_the_force():
    full, infos = run(CALM, _Beside(MOVING, (-0.05, 0.05)), 12)
    half, halves = run(replace(CALM, box=replace(BOX, symmetric=True)), _Beside(MOVING, (0.05,)), 12)
    assert half.particles == full.particles // 2
    lift, doubled = force(infos)[:, 2], 2.0 * force(halves)[:, 2]
    np.testing.assert_allclose(doubled, lift, atol=0.01 * np.abs(lift).max())


def test_a_plate_that_goes_on_in_its_mirror_image_gives_half_the_force_of_the_whole():
    stream = replace(CALM, fringe=Fringe(width=0.05, rate=200.0))
    plate = FixedPlate(0.05, 0.075, DP / 2, np.radians(30.0))
    _, infos = run(stream, plate, 25, airspeed=2.0)
    half = replace(stream, box=replace(BOX, symmetric=True))
    _, halves = run(half, replace(plate, half=True), 25, airspeed=2.0)
    whole, doubled = force(infos)[:, [0, 2]], 2.0 * force(halves)[:, [0, 2]]
    np.testing.assert_allclose(doubled, whole, atol=0.015 * np.abs(whole).max())


def test_no_particle_is_lost_or_passes_the_plate():
    solver, _ = run(CALM, MOVING, 30)
    assert sorted(solver.identity) == list(range(solver.particles))
    assert solver.crossings == 0


def test_a_flow_that_blows_up_is_reported_with_its_time():
    solver = Solver(CALM, MOVING, 0.0)
    solver.step()
    solver.velocity[0] = np.nan
    with pytest.raises(WorkError, match="undefined at t = "):
        _steps(solver, 3)


def test_a_box_smaller_than_the_support_is_refused():
    with pytest.raises(InputError, match=r"extent in x is 0.05 m; allowed: at least"):
        Solver(replace(CALM, box=replace(BOX, length=0.05)), None, 0.0)


class _Drifting:
    """A plate carried along x at a constant speed."""

    def __init__(self, plate, speed):
        self._plate, self._speed = plate, speed
        self.triangles, self.panel, self.panel_names = plate.triangles, plate.panel, plate.panel_names

    def state(self, t):
        nodes = self._plate.state(t)
        along = np.array([self._speed, 0.0, 0.0])
        return replace(nodes, x=nodes.x + t * along, v=nodes.v + along)


class _Beside:
    """Equal plates side by side."""

    def __init__(self, plate, offsets):
        self._plate, self._offsets = plate, offsets
        nodes, count = len(plate.state(0.0).x), len(offsets)
        self.triangles = np.concatenate([plate.triangles + k * nodes for k in range(count)])
        self.panel = np.repeat(np.arange(count), len(plate.triangles))
        self.panel_names = tuple(f"plate {k}" for k in range(count))

    def state(self, t):
        nodes = self._plate.state(t)
        x = np.concatenate([nodes.x + np.array([0.0, offset, 0.0]) for offset in self._offsets])
        count = len(self._offsets)
        return replace(nodes, x=x, v=np.tile(nodes.v, (count, 1)), a=np.tile(nodes.a, (count, 1)))
