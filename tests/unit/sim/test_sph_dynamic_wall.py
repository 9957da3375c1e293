# SPDX-License-Identifier: Apache-2.0
"""The plain wall of one layer of particles, kept for comparison."""

from dataclasses import replace

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_sim.case import preset, with_overrides
from cwmav_sim.solver import Solver
from cwmav_sim.sph.dynamic import DynamicWall
from cwmav_sim.sph.settings import Box, FlowSettings, Fluid, Fringe, Resolution, SheetOptions, Shifting
from cwmav_sim.verification.plates import FixedPlate, OscillatingPlate

DP = 0.0125
BOX = Box(length=0.2, width=0.2, height=0.2, upstream=0.1, symmetric=False)
PLAIN = FlowSettings(
    fluid=Fluid(sound_speed=20.0),
    resolution=Resolution(dp=DP, cfl=0.4, precision="double", jitter=0.0),
    box=BOX,
    fringe=Fringe(width=0.0),
    sheet=SheetOptions(treatment="dbc"),
)
MOVING = OscillatingPlate(chord=0.05, span=0.05, spacing=DP, amplitude=0.01, frequency=8.0)


def run(settings, motion, steps=15):
    solver = Solver(settings, motion, 0.0)
    lift = [(i.pressure + i.viscous)[0, 2] for i in (solver.step() for _ in range(steps))]
    return solver, np.array(lift)


def test_momentum_given_to_the_air_equals_the_force_on_the_wall_particles():
    solver, _ = run(PLAIN, MOVING)
    scale = np.linalg.norm(solver.wall_impulse)
    assert scale > 1e-6
    np.testing.assert_allclose(solver.momentum(), -solver.wall_impulse, atol=1e-9 * scale)


def test_power_is_force_times_speed():
    solver = Solver(PLAIN, MOVING, 0.0)
    for _ in range(5):
        begin, info = solver.time, solver.step()
        speed = MOVING.speed(begin + 0.5 * info.dt)
        work = -float((info.pressure + info.viscous)[0, 2]) * speed
        assert float(info.power[0]) == pytest.approx(work, rel=1e-9, abs=1e-12)


def test_a_plain_wall_loses_the_suction_that_a_two_sided_one_feels():
    _, plain = run(PLAIN, MOVING)
    _, two_sided = run(replace(PLAIN, sheet=SheetOptions()), MOVING)
    assert 0.1 < plain[-1] / two_sided[-1] < 0.7


def test_particles_on_a_square_lie_in_rows_along_the_axes():
    full, half = (DynamicWall.on(plate, DP, 1.2, 3) for plate in (MOVING, replace(MOVING, half=True)))
    x = full.placed(MOVING.state(0.0), False, 3).x
    assert len(full.panel) == 2 * len(half.panel) == 16
    rows = DP * (np.arange(4) - 1.5)
    expected = [(a, b) for a in rows for b in rows]
    assert sorted(map(tuple, np.round(x[:, :2], 9))) == sorted(map(tuple, np.round(expected, 9)))


def test_half_a_model_gives_half_the_force():
    _, full = run(PLAIN, MOVING)
    _, half = run(replace(PLAIN, box=replace(BOX, symmetric=True)), replace(MOVING, half=True))
    np.testing.assert_allclose(2.0 * half, full, atol=0.02 * np.abs(full).max())


def test_air_at_rest_stays_at_rest():
    solver, lift = run(PLAIN, replace(MOVING, amplitude=0.0), 5)
    assert np.array_equal(solver.velocity, np.zeros_like(solver.velocity))
    assert not lift.any()


def test_what_passes_through_is_counted_and_left_where_it_is():
    solver = Solver(PLAIN, replace(MOVING, amplitude=0.0), 0.0)
    solver.velocity[:, 2] = -4.0  # a gust that walls of particles do not stop
    surely, perhaps, counted = 0, 0, 0
    before = None
    for _ in range(40):
        now = np.empty((solver.particles, 3))
        now[solver.identity] = solver.position
        if before is not None:
            z0, z1 = before[:, 2], now[:, 2]
            through = ((z0 > 0.0) != (z1 > 0.0)) & (np.abs(z1) < DP)  # others went around the periodic box
            part = (z0[through] / (z0 - z1)[through])[:, None]
            at = before[through, :2] + part * (now - before)[through, :2]
            from_middle = np.abs(at).max(axis=1)
            surely += int((from_middle < 0.025 - 0.25 * DP).sum())
            perhaps += int((from_middle < 0.025 + 0.75 * DP).sum())
        counted += solver.step().crossings
        before = now
    assert surely > 10
    assert surely <= counted <= perhaps
    assert counted == solver.crossings


@pytest.mark.parametrize("coefficient", [0.0, 0.5])
def test_nothing_eases_air_away_from_wall_particles(coefficient):
    shifting = Shifting(coefficient=coefficient)
    near, _ = run(replace(PLAIN, shifting=shifting), MOVING, 25)
    far, _ = run(replace(PLAIN, shifting=shifting, sheet=replace(PLAIN.sheet, keep_out=0.9)), MOVING, 25)
    assert np.array_equal(near.position, far.position)


def test_density_of_the_wall_never_falls_below_that_at_rest():
    wall = DynamicWall.on(MOVING, DP, 1.2, 3)
    wall.predict(np.full(wall.panel.shape, -5.0), 0.01)
    wall.correct(np.full(wall.panel.shape, -5.0), 0.01)
    assert (wall.density == 1.2).all()
    wall.predict(np.full(wall.panel.shape, 5.0), 0.01)
    wall.correct(np.full(wall.panel.shape, 5.0), 0.01)
    assert (wall.density > 1.2).all()


def test_wall_particles_cover_a_tilted_plate_one_spacing_apart():
    plate = FixedPlate(0.05, 0.1, DP, 0.4)
    x = DynamicWall.on(plate, DP, 1.0, 3).placed(plate.state(0.0), False, 3).x
    assert len(x) == 4 * 8
    gaps = np.linalg.norm(x[:, None] - x[None], axis=2)
    np.fill_diagonal(gaps, 1.0)
    np.testing.assert_allclose(gaps.min(axis=1), DP, rtol=1e-6)


def test_wings_of_a_preset_can_have_plain_walls():
    case = with_overrides(preset("smoke"), ["flow.sheet.treatment=dbc"])
    solver = Solver(case.flow, case.motion(), case.airspeed)
    for _ in range(3):
        assert np.isfinite(solver.step().pressure).all()


def test_an_unknown_treatment_is_refused():
    with pytest.raises(InputError, match=r"two-sided.*dbc"):
        with_overrides(preset("smoke"), ["flow.sheet.treatment=glass"])
