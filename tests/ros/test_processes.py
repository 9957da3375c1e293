# SPDX-License-Identifier: Apache-2.0
"""The nodes as real processes: an optimisation through all three, a restart, the stop, bad parameters."""

from __future__ import annotations

import csv
import json
import math
import os
import signal
import subprocess
import threading
from pathlib import Path
from typing import Any

import pytest
import yaml
from cwmav_msgs.action import Optimise
from cwmav_msgs.msg import ControlPoint
from cwmav_msgs.srv import EvaluateLift
from rcl_interfaces.srv import GetParameters

from cwmav_common.mcap_reader import open_recording
from cwmav_rbdo.ros.session import Client, NodeProcesses, find_executable
from cwmav_sim.case import preset
from cwmav_sim.sweep import write_table
from support.ros_harness import DOMAIN, wait_for
from support.sim_results import result_for

START = 120.0  # s; nodes import a lot, and the machine may be busy
NODES = {"cwmav_sim": "sim_node", "cwmav_rig": "rig_node", "cwmav_rbdo": "optimiser_node"}


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """Make a lift table of a smooth formula."""
    results = [
        result_for(preset("smoke").at(f, a, u), lift(f, math.radians(a), u))
        for f in (4.0, 12.0, 21.0, 30.0)
        for a in (-10.0, 15.0, 35.0, 60.0)
        for u in (2.0, 3.0, 4.0)
    ]
    path = tmp_path / "table.csv"
    write_table(results, path)
    return path


def lift(frequency: float, angle: float, airspeed: float) -> float:
    """Give a lift that grows with speed and frequency and has its maximum at 40 degrees [N]."""
    return 0.012 * (1.0 + 0.05 * frequency) * airspeed * math.sin(2.25 * angle)


def problem(**changes: Any) -> str:
    content = {
        "id": "small",
        "kind": "lift_to_power",
        "design": [{"name": "F", "lo": 6, "hi": 26}, {"name": "AoA", "lo": 0, "hi": 50}],
        "fixed": {"U": 3.0},
        "require": {"lift_to_power": 0.001, "reliability": 0.9},
        "initial_samples": 6,
        "max_iterations": 2,
        "criteria": {"c1": 0.9, "c2": 0.9},
        "evaluate": "ros",
    }
    return yaml.safe_dump(content | changes)


def test_an_optimisation_through_three_processes(table: Path, recording: Path, tmp_path: Path) -> None:
    """The simulation node is killed in the middle of a request and started again; the study goes on."""
    rows: dict[int, Any] = {}
    waiting = threading.Event()

    with NodeProcesses(DOMAIN) as nodes, Client(DOMAIN, nodes.check) as client:
        sim = {"lift_table": table, "store": tmp_path / "store"}
        nodes.start("cwmav_rig", "rig_node", {"recording": recording})
        process = nodes.start("cwmav_sim", "sim_node", sim)
        nodes.start("cwmav_rbdo", "optimiser_node", {"run_root": tmp_path / "runs"})

        def watch(feedback: Any) -> None:
            if feedback.iteration.evaluations:
                if not rows:
                    os.kill(process, signal.SIGSTOP)  # the next request finds a node that does not answer
                rows[feedback.iteration.iteration] = feedback.iteration
                if feedback.pending:
                    waiting.set()

        def restart() -> None:
            assert waiting.wait(START)
            nodes.stop("sim_node", signal.SIGKILL)
            nodes.start("cwmav_sim", "sim_node", sim)

        restarter = threading.Thread(target=restart)
        restarter.start()
        result = client.act(Optimise, "/optimiser/optimise", START, watch, problem=problem(), seed=3)
        restarter.join(START)

    assert waiting.is_set()
    folder = Path(result.run_folder)
    assert folder.parent == tmp_path / "runs"
    content = json.loads((folder / "result.json").read_text())
    assert content["design"]["AoA"] == pytest.approx(math.degrees(result.design.angle_of_attack))
    assert content["true_evaluations"] == result.evaluations >= 7
    assert (
        "12 recordings" in str(content) or "recordings" in (folder / "journal" / "journal.jsonl").read_text()
    )
    table_rows = list(csv.DictReader((folder / "iterations.csv").read_text().splitlines()))
    assert [int(row["iteration"]) for row in table_rows] == sorted(rows) == list(range(len(rows)))
    assert "<html" in (folder / "report.html").read_text()[:200].lower()
    assert (folder / "config.yaml").is_file()
    with open_recording(folder / "run.mcap") as bag:
        counts = {name: topic.count for name, topic in bag.topics.items()}
    assert counts["/optimiser/iteration"] == len(rows)
    assert counts["/diagnostics"] > 3


def test_sigint_stops_every_node_cleanly(recording: Path) -> None:
    with NodeProcesses(DOMAIN) as nodes, Client(DOMAIN, nodes.check) as client:
        parameters = {"rig_node": {"recording": recording}}
        groups = {
            name: nodes.start(package, name, parameters.get(name, {})) for package, name in NODES.items()
        }
        for name in ("sim", "rig", "optimiser"):
            client.call(GetParameters, f"/{name}/get_parameters", START, names=["use_sim_time"])
        for name, group in groups.items():
            assert nodes.stop(name) == 0, name
            wait_for(lambda group=group: not alive(group), f"end of all processes of {name}")


def alive(group: int) -> bool:
    """Say whether a process group still has members."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize(
    ("package", "parameter", "expected"),
    [
        ("cwmav_sim", "workers:=0", "parameter workers"),
        ("cwmav_sim", "fidelity:=finest", "'fidelity' is 'finest'; allowed: one of table, smoke"),
        ("cwmav_rig", "recording:=/no/such/bag", "/no/such/bag: no such recording"),
        ("cwmav_rbdo", "patience:=soon", "parameter patience"),
    ],
)
def test_a_bad_parameter_ends_the_start(package: str, parameter: str, expected: str) -> None:
    command = [find_executable(package, NODES[package]), "--ros-args", "-p", parameter]
    environment = os.environ | {"ROS_DOMAIN_ID": str(DOMAIN)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert expected in done.stderr
    assert "Traceback" not in done.stderr


def test_evaluate_lift_answers_from_the_given_table(table: Path) -> None:
    with NodeProcesses(DOMAIN) as nodes, Client(DOMAIN, nodes.check) as client:
        nodes.start("cwmav_sim", "sim_node", {"lift_table": table})
        request = {"flapping_frequency": 12.0, "angle_of_attack": math.radians(35.0), "forward_velocity": 3.0}
        answer = client.call(EvaluateLift, "/sim/evaluate_lift", START, point=ControlPoint(**request))
        assert answer.lift == pytest.approx(lift(12.0, math.radians(35.0), 3.0), rel=0.05)
        assert "48 SPH runs" in answer.source
