# SPDX-License-Identifier: Apache-2.0
"""A case starts from the air of another one: what is carried over, and what is refused."""

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from cwmav_common.errors import InputError
from cwmav_sim import case as cases
from cwmav_sim import run as running
from cwmav_sim.cli import cli
from cwmav_sim.solver import Solver
from cwmav_sim.warm import EndState, fill, started

TINY = ["flow.resolution.dp=0.03", "kinematics.clap_half_gap_deg=15", "run.discard=0"]
LARGE = ["flow.box.length=0.6", "flow.box.width=0.6", "flow.box.height=0.48", "flow.box.upstream=0.2"]
LENGTH = ["run.cycles=1", "run.cycles_max=1"]


def tiny(*changes):
    return cases.with_overrides(cases.preset("smoke"), [*TINY, *LARGE, *LENGTH, *changes])


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """Folder and result of a run that left its air."""
    folder = tmp_path_factory.mktemp("source")
    return folder, running.simulate(tiny(), out=folder, keep_state=folder)


def start_of(case):
    return Solver(case.flow, case.motion(), case.airspeed, highest_speed=case.highest_speed())


def test_air_is_scaled_with_the_frequency_and_carried_by_the_new_stream(source):
    start = EndState.read(source[0])
    assert start.address == source[1].address == tiny().address()
    case = started(tiny().at(20.0, 15.0, 2.0), start)
    solver = start_of(case)
    fill(solver, case, start)
    assert np.array_equal(solver.position, start.x)
    stream = np.array([1.0, 0.0, 0.0])
    expected = 2.0 * stream + 20.0 / 16.0 * (start.v - 3.5 * stream)
    assert np.allclose(solver.velocity, expected)
    assert np.allclose(solver.pressure, (20.0 / 16.0) ** 2 * start.pressure, atol=1e-6)
    assert solver.time == solver.steps == solver.crossings == 0


def test_wings_are_in_full_motion_at_once(source):
    case = tiny()
    rest, warm = case.motion(), started(case, EndState.read(source[0])).motion()
    period = 1.0 / case.flapping_frequency
    for phase in (0.0, 0.1, 0.4):
        late = rest.state((2.0 + phase) * period)
        assert np.allclose(warm.state(phase * period).x, late.x)
        assert np.allclose(warm.state(phase * period).v, late.v, atol=1e-9)
    assert not np.allclose(rest.state(0.0).x, warm.state(0.0).x)


def test_same_point_goes_on_where_the_source_stopped(source):
    """The force at the start is that at the end of the source; air at rest would give another one."""
    folder, cold = source
    start = EndState.read(folder)
    warm = running.simulate(started(tiny(), start), start=start)
    first, last = warm.history.lift()[2], cold.history.lift()[-1]
    rest = cold.history.lift()[2]
    assert abs(first - last) < 0.3 * abs(rest - last)
    assert warm.history.time[0] > 0.0
    assert warm.cycles == 1
    assert math.isfinite(warm.details["balance"]["momentum_residual"])


def test_address_says_from_which_run_a_case_started(source):
    start = EndState.read(source[0])
    warm = started(tiny(), start)
    assert warm.run.start_from == start.address
    assert warm.address() != tiny().address()
    other = EndState(start.case, 32 * "0", start.x, start.v, start.pressure)
    assert started(tiny(), other).address() != warm.address()


def test_other_numerics_are_refused_and_named(source):
    start = EndState.read(source[0])
    with pytest.raises(InputError, match=r"flow\.fluid\.diffusion = 0\.1 \(here 0\.2\)"):
        started(tiny("flow.fluid.diffusion=0.2"), start)
    started(tiny("run.cycles=2", "run.cycles_max=2"), start)


def test_a_state_that_is_not_the_named_one_is_refused(source):
    start = EndState.read(source[0])
    case = started(tiny(), EndState(start.case, 32 * "0", start.x, start.v, start.pressure))
    for given in (None, start):
        with pytest.raises(InputError, match=32 * "0"):
            running.simulate(case, start=given)
    with pytest.raises(InputError, match="from the air of run none"):
        running.simulate(tiny(), start=start)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["run.start_from=there"], "32 hexadecimal digits"),
        ([f"run.start_from={32 * 'a'}", "wing.model=membrane", "flow.resolution.cfl=0.1"], "prescribed"),
        ([f"run.start_from={32 * 'a'}", "run.flapping=false"], "flapping"),
    ],
)
def test_starts_that_cannot_be_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        tiny(*changes)


def test_damaged_and_absent_states_are_named(tmp_path):
    with pytest.raises(InputError, match="--keep-state"):
        EndState.read(tmp_path)
    (tmp_path / "state.npz").write_bytes(b"no state")
    with pytest.raises(InputError, match="holds no state"):
        EndState.read(tmp_path)


def test_command_line(source, tmp_path):
    point = ["-F", "17", "-A", "15", "-U", "3.5", "--json", "--out", str(tmp_path / "run")]
    sets = [word for setting in (*TINY, *LARGE, *LENGTH) for word in ("--set", setting)]
    done = CliRunner().invoke(cli, ["run", *point, *sets, "--start-from", str(source[0])])
    assert done.exit_code == 0, done.output
    start = EndState.read(source[0])
    case = started(tiny().at(17.0, 15.0, 3.5), start)
    assert json.loads(done.stdout)["address"] == case.address()
    assert not (tmp_path / "run" / "state.npz").exists()
    again = cases.load_case(tmp_path / "run" / "config.yaml")
    assert again.run.start_from == start.address


def test_sweep_keeps_the_air_and_starts_rows_from_it(tmp_path):
    table, out = tmp_path / "points.csv", tmp_path / "sweep"
    table.write_text("F_hz,U_m_s,AoA_deg\n16,3.5,15\n18,3.5,15\n")
    sets = [word for setting in (*TINY, *LARGE, *LENGTH) for word in ("--set", setting)]
    command = ["sweep", str(table), "--out", str(out), "--start-nearest", "--json", *sets]
    done = CliRunner().invoke(cli, command)
    assert done.exit_code == 0, done.output
    first, second = json.loads(done.stdout)["cases"]
    assert first["address"] == tiny().address()
    state = EndState.read(out / "states" / first["address"])
    assert second["address"] == started(tiny().at(18.0, 15.0, 3.5), state).address()
    assert (out / "states" / second["address"] / "state.npz").exists()
