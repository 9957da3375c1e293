# SPDX-License-Identifier: Apache-2.0
"""Flexible wings in the air: what must not be lost between them, and what must stay stable."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cwmav_common.errors import InputError, WorkError
from cwmav_sim import case as cases
from cwmav_sim.coupling import Normals
from cwmav_sim.solver import Solver
from cwmav_sim.sph.sheet import SheetLoad, SheetQuadrature
from cwmav_sim.verification.coupled import EnergyOfExchange
from cwmav_sim.wing.hinge import Hinges, panels
from cwmav_sim.wing.prescribed import Attitude
from cwmav_sim.wing.sheet import SheetState

MODELS = ("membrane", "lattice")
COARSE = [
    "flow.resolution.dp=0.02",
    "flow.resolution.cfl=0.25",
    "flow.resolution.precision=double",
    "flow.box.length=0.5",
    "flow.box.width=0.48",
    "flow.box.height=0.36",
    "kinematics.clap_half_gap_deg=12",
    "structure.lattice.spanwise=3",
    "structure.lattice.chordwise=2",
]
LIGHT = ["structure.film.density=300", "flow.resolution.cfl=0.08"]


def coarse(model, *more):
    return cases.with_overrides(cases.preset("smoke"), [f"wing.model={model}", *COARSE, *more])


def solver_of(case):
    motion = case.motion()
    return motion, Solver(case.flow, motion, case.airspeed, highest_speed=case.highest_speed())


def run(case, steps):
    """Return wings, solver and the records of some steps."""
    motion, solver = solver_of(case)
    return motion, solver, [solver.step() for _ in range(steps)]


def bent(motion, seed=1):
    """Return nodes displaced and moving at random."""
    rng = np.random.default_rng(seed)
    state = motion.state(0.0)
    fields = (state.x, state.v, state.a)
    x, v, a = (f + s * rng.normal(size=f.shape) for f, s in zip(fields, (1e-3, 1.0, 100.0), strict=True))
    return replace(state, x=x, v=v, a=a)


@pytest.mark.parametrize("model", MODELS)
def test_nodes_receive_the_force_moment_and_power_of_the_elements(model):
    motion = coarse(model).motion()
    quadrature = SheetQuadrature(
        motion, spacing=0.006, probe_spacing=0.01, set_back=0.01, dimensions=3, mirrored=True
    )
    nodes = bent(motion)
    placed, weights = quadrature.place(nodes), quadrature.weights(len(nodes.x))
    force = np.random.default_rng(2).normal(size=placed.x.shape)
    at_nodes = weights.T @ force
    assert_allclose(at_nodes.sum(axis=0), force.sum(axis=0), atol=1e-12)
    assert_allclose(
        np.cross(nodes.x, at_nodes).sum(axis=0), np.cross(placed.x, force).sum(axis=0), atol=1e-13
    )
    assert np.sum(nodes.v * at_nodes) == pytest.approx(np.sum(placed.v * force), rel=1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_unknowns_of_the_structure_receive_the_force_and_power_of_the_nodes(model):
    structure = coarse(model).motion().structure
    rng = np.random.default_rng(3)
    c = structure.save().configuration
    c = c._replace(v=rng.normal(size=c.v.shape), spin=rng.normal(size=c.spin.shape))
    state = structure.sheet.state(c, np.zeros_like(c.rates))
    force = rng.normal(size=state.x.shape)
    on_rows = structure.sheet.load(c, force)
    n = structure.system.nodes
    assert_allclose(on_rows[:n].sum(axis=0), force.sum(axis=0), atol=1e-12)
    assert np.sum(on_rows * c.rates) == pytest.approx(np.sum(force * state.v), rel=1e-11)
    if model == "lattice":
        moment = np.cross(c.x, on_rows[:n]).sum(axis=0) + on_rows[n:].sum(axis=0)
        assert_allclose(moment, np.cross(state.x, force).sum(axis=0), atol=1e-12)


def test_reactions_of_the_elements_add_up_to_the_load_of_the_panels():
    case = coarse("membrane")
    motion, solver, _ = run(case, 3)
    nodes = solver.sheet
    rates = solver._interaction.rates(solver._air, nodes, shifting=False, reactions=True)
    load = solver._interaction.sheet_load(rates, nodes)
    panel_force = rates.pressure + rates.viscous
    scale = np.abs(panel_force).max()
    upper = np.unique(motion.triangles[motion.panel == 0])
    assert_allclose(load.force[upper].sum(axis=0), panel_force[0], atol=1e-12 * scale)
    assert_allclose(load.force.sum(axis=0), panel_force.sum(axis=0), atol=1e-12 * scale)
    assert np.sum(load.force * nodes.v) == pytest.approx(-rates.power.sum(), rel=1e-9)
    moment = np.cross(nodes.x, load.force).sum(axis=0)
    # Friction is no central force: it acts on particles beside the wall, by a hundredth of the moment here.
    assert_allclose(rates.moment.sum(axis=0), moment, atol=0.02 * np.abs(moment).max())


def test_carried_air_is_what_the_load_falls_by_per_acceleration():
    case = coarse("membrane")
    motion, solver, _ = run(case, 2)
    nodes, normal = solver.sheet, Normals(motion.triangles).of(solver.sheet.x)
    faster = replace(nodes, a=nodes.a + 50.0 * normal)
    loads = []
    for state in (nodes, faster):
        rates = solver._interaction.rates(solver._air, state, shifting=False, reactions=True)
        loads.append(solver._interaction.sheet_load(rates, state))
    lost = np.sum((loads[0].force - loads[1].force) * normal) / 50.0
    assert lost == pytest.approx(loads[0].carried.sum(), rel=0.01)
    assert loads[0].carried.min() >= 0.0
    areal = loads[0].carried.sum() / (2 * case.wing.area)
    assert 0.1 < areal / (1.225 * 0.02) < 2.0, "of the order of a layer of one spacing"


class Swinging:
    """The flat wings of a case, which swing with their hinges whatever the air does."""

    def __init__(self, case):
        wings = case.motion()
        self.triangles, self.panel, self.panel_names = wings.triangles, wings.panel, wings.panel_names
        attitude = Attitude(case.flapping_frequency, case.angle_of_attack, case.airspeed)
        self._hinges = Hinges(
            case.kinematics, case.flapping_frequency, attitude.angle_of_attack, panels(True)
        )
        axes = self._hinges.at(0.0).axes
        halves = zip(np.split(wings.state(0.0).x, 2), axes, strict=True)
        self._flat = [x @ frame for x, frame in halves]

    def state(self, t):
        swing = self._hinges.at(t)
        x = np.concatenate([flat @ axes.T for flat, axes in zip(self._flat, swing.axes, strict=True)])
        count = len(self._flat[0])
        spin, rate = (np.repeat(w, count, axis=0) for w in (swing.spin, swing.spin_rate))
        v = np.cross(spin, x)
        return SheetState(x, v, np.cross(rate, x) + np.cross(spin, v))


def test_a_stiff_wing_follows_the_prescribed_motion_and_feels_its_forces():
    stiff = [
        "structure.film.modulus=1e11",
        "structure.film.thickness=1e-3",
        "structure.film.density=9.2",
        "structure.lattice.joint_scale=1e5",
        "structure.lattice.ball_joint=1e8",
        "structure.root.trailing_edge=hinge",
    ]
    case = coarse("lattice", *stiff)
    _, solver, infos = run(case, 50)
    rigid = Swinging(case)
    alone = Solver(case.flow, rigid, case.airspeed, highest_speed=case.highest_speed())
    alone_infos = [alone.step() for _ in range(50)]
    assert alone.time == pytest.approx(solver.time, rel=1e-3)
    expected = rigid.state(solver.time).x
    travelled = np.abs(expected - rigid.state(0.0).x).max()
    assert travelled > 1e-3
    assert np.abs(solver.sheet.x - expected).max() < 0.01 * travelled
    one, other = (
        np.array([(i.pressure + i.viscous)[:, 2] for i in records]) for records in (infos, alone_infos)
    )
    assert_allclose(one[10:], other[10:], atol=0.05 * np.abs(other).max())


@pytest.mark.parametrize("model", MODELS)
def test_what_the_air_loses_the_wings_gain(model):
    case = coarse(model, "flow.fringe.width=0")
    motion, solver = solver_of(case)
    start = solver.momentum()
    received = np.zeros(3)
    accept = motion.accept

    def count(t, load):
        received[:] += (t - motion.structure.time) * load.force.sum(axis=0)
        accept(t, load)

    motion.accept = count
    for _ in range(15):
        solver.step()
    gained = solver.momentum() - start
    scale = np.linalg.norm(received)
    assert scale > 1e-6
    # The mirror gives sideways momentum to the half model.
    assert_allclose(gained[[0, 2]], -received[[0, 2]], atol=1e-9 * scale)


@pytest.mark.parametrize("model", MODELS)
def test_wings_lighter_than_the_air_they_carry_stay_calm(model):
    case = coarse(model, *LIGHT)
    motion, solver = solver_of(case)
    for _ in range(50):
        solver.step()
        assert np.abs(solver.sheet.v).max() < 10.0
    assert motion.structure.counters.halvings == 0


@pytest.mark.parametrize("model", MODELS)
def test_without_carried_air_they_are_thrown_away(model):
    case = coarse(model, *LIGHT, "coupling.carried_air=0")
    _, solver = solver_of(case)

    def go_on():
        for _ in range(50):
            solver.step()
            if np.abs(solver.sheet.v).max() > 10.0:
                raise WorkError("thrown away")

    with pytest.raises((WorkError, ArithmeticError, RuntimeWarning)):
        go_on()


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_energies_of_a_cycle_at_twelve_millimetres_close(model):
    checks = EnergyOfExchange(model).run()
    assert checks[0].scale > 5e-3
    assert [c.quantity for c in checks if not c.passed] == []


@pytest.mark.parametrize("model", MODELS)
def test_saved_wings_go_on_with_the_same_bits(model):
    case = coarse(model)
    motion = case.motion()
    count = len(motion.state(0.0).x)
    load = SheetLoad(np.full((count, 3), 1e-5), np.full(count, 1e-6))

    def go_on(wings, steps):
        for _ in range(steps):
            t = wings.structure.time + 2e-4
            wings.foresee(t, load)
            wings.accept(t, load)
        return wings.state(wings.structure.time)

    go_on(motion, 5)
    motion.settle()
    saved = motion.save()
    one = go_on(motion, 5)
    other = case.motion()
    other.restore(saved)
    two = go_on(other, 5)
    assert np.array_equal(one.x, two.x)
    assert np.array_equal(one.a, two.a)
    assert motion.energies == other.energies


def test_foreseeing_changes_nothing_but_what_is_foreseen():
    motion = coarse("membrane").motion()
    count = len(motion.state(0.0).x)
    load = SheetLoad(np.full((count, 3), 1e-5), np.full(count, 1e-6))
    before, energies = motion.save(), motion.energies
    motion.foresee(2e-4, load)
    after = motion.save()
    assert motion.energies == energies
    assert np.abs(after.pop("done.sheet") - before.pop("done.sheet")).max() > 0.0
    assert np.abs(after.pop("done.unknowns") - before.pop("done.unknowns")).max() > 0.0
    assert all(np.array_equal(after[name], before[name]) for name in before)


def test_what_cannot_be_foreseen_leaves_the_wings_where_they_are():
    motion = coarse("membrane").motion()
    count = len(motion.state(0.0).x)
    with pytest.raises(WorkError):
        motion.foresee(2e-4, SheetLoad(np.full((count, 3), 1e9), np.full(count, 1e-6)))
    assert motion.structure.time == 0.0


def test_wings_do_not_look_back():
    motion = coarse("membrane").motion()
    count = len(motion.state(0.0).x)
    motion.accept(1e-4, SheetLoad(np.zeros((count, 3)), np.zeros(count)))
    with pytest.raises(ValueError, match="is past"):
        motion.state(0.5e-4)


def test_folded_wing_is_a_failure_of_work():
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0]])
    with pytest.raises(WorkError, match="folded"):
        Normals(np.array([[0, 1, 2], [1, 0, 3]])).of(x)


def test_unknown_model_is_refused():
    with pytest.raises(InputError, match="one of prescribed, membrane, lattice"):
        coarse("rubber")


@pytest.mark.slow
def test_plain_walls_move_flexible_wings_too():
    motion, solver = solver_of(coarse("membrane", "flow.sheet.treatment=dbc"))
    work = 0.0
    for _ in range(40):
        info = solver.step()
        work += info.dt * float(info.power.sum())
    assert motion.energies.load_work == pytest.approx(-work, rel=0.15)
    assert np.abs(solver.sheet.v).max() < 3.0
