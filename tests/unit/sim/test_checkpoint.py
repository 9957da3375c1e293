# SPDX-License-Identifier: Apache-2.0
"""A run that is interrupted goes on with the same bits; accounts of a run close."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_sim import case as cases
from cwmav_sim.checkpoint import Checkpoint
from cwmav_sim.run import simulate

SMALL = [
    "flow.resolution.dp=0.02",
    "flow.resolution.cfl=0.25",
    "flow.resolution.precision=double",
    "kinematics.opening_deg=30",
    "flow.box.length=0.5",
    "flow.box.width=0.48",
    "flow.box.height=0.36",
    "kinematics.clap_half_gap_deg=20",
    "structure.lattice.spanwise=3",
    "structure.lattice.chordwise=2",
    "flapping_frequency=30",
    "run.cycles=1",
    "run.discard=0",
    "run.cycles_max=1",
]


class PowerCutError(Exception):
    """Ends a run as a power cut would."""


def small(model, *more):
    return cases.with_overrides(cases.preset("smoke"), [f"wing.model={model}", *SMALL, *more])


def cut_at(cycles, case):
    def observe(solver):
        if solver.time * case.flapping_frequency >= cycles:
            raise PowerCutError

    return observe


@pytest.mark.parametrize("model", ["prescribed", pytest.param("membrane", marks=pytest.mark.slow)])
def test_a_continued_run_has_the_bits_of_an_uninterrupted_one(model, tmp_path):
    case = small(model, "flow.resolution.cfl=0.4") if model == "prescribed" else small(model)
    whole = simulate(case, out=tmp_path / "whole")
    with pytest.raises(PowerCutError):
        simulate(case, out=tmp_path / "cut", observers=[cut_at(0.45, case)])
    assert (tmp_path / "cut" / "checkpoint.npz").exists()
    seen = []
    continued = simulate(case, out=tmp_path / "cut", resume=True, on_progress=seen.append)
    assert seen[0].fraction > 0.3, "it did not start anew"
    assert np.array_equal(continued.history.time, whole.history.time)
    assert np.array_equal(continued.history.pressure, whole.history.pressure)
    assert np.array_equal(continued.history.inertial, whole.history.inertial)
    assert continued.mean_lift == whole.mean_lift
    assert not (tmp_path / "cut" / "checkpoint.npz").exists()
    histories = [(tmp_path / name / "history.csv").read_bytes() for name in ("whole", "cut")]
    assert histories[0] == histories[1]
    _check_accounts(continued.details, model)


def _check_accounts(details, model):
    balance = details["balance"]
    assert balance["particles_lost"] == 0
    assert balance["momentum_residual"] < 1e-9, "double precision"
    air = balance["air_j"]
    assert air["work_of_wings"] > 0
    if model == "membrane":
        wings = balance["wings_j"]
        assert wings["made_by_exchange"] == pytest.approx(air["work_of_wings"] + wings["load_work"])
    parts = details["parts"]
    assert abs(parts["viscous"]["lift_n"]["mean"]) < abs(parts["pressure"]["lift_n"]["mean"])
    assert details["cost"]["pair_interactions_per_s"] > 0
    assert set(details["cost"]["phases_s"]) >= {"sort", "walls", "pairs", "update"}


def test_a_checkpoint_of_another_case_is_refused(tmp_path):
    Checkpoint(tmp_path, "one").write({"x": np.zeros(3)})
    assert np.array_equal(Checkpoint(tmp_path, "one").read()["x"], np.zeros(3))
    with pytest.raises(InputError, match=r"belongs to case one; allowed: two"):
        Checkpoint(tmp_path, "two").read()


def test_a_damaged_checkpoint_is_refused(tmp_path):
    (tmp_path / "checkpoint.npz").write_bytes(b"PK\x03\x04 torn")
    with pytest.raises(InputError, match="is no checkpoint"):
        Checkpoint(tmp_path, "one").read()


def test_without_a_checkpoint_there_is_nothing_to_read(tmp_path):
    assert Checkpoint(tmp_path, "one").read() is None


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_a_killed_program_is_continued(tmp_path):
    case = small("membrane")
    cases.dump_case(case, tmp_path / "case.yaml")
    command = [sys.executable, "-c", "from cwmav_sim.cli import main; main()", "run", "--json"]
    command += ["--case", str(tmp_path / "case.yaml"), "--out", str(tmp_path / "run")]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    limit = time.monotonic() + 250
    while not (tmp_path / "run" / "checkpoint.npz").exists():
        assert process.poll() is None
        assert time.monotonic() < limit
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    done = subprocess.run([*command, "--resume"], capture_output=True, check=True, text=True)
    whole = simulate(case, out=tmp_path / "whole")
    assert json.loads(done.stdout)["mean_lift_n"] == whole.mean_lift
    histories = [(tmp_path / name / "history.csv").read_bytes() for name in ("whole", "run")]
    assert histories[0] == histories[1]
