# SPDX-License-Identifier: Apache-2.0
"""The whole suite at work: three nodes, one recording, one optimisation, one check. `make demo` runs this.

Nothing here computes. The rig node replays the recording and measures the scatter, the simulation node gives
lift, the optimiser node asks both over their services, and this program prints what it hears from them.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from cwmav_common.cli import app, main_guard
from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import open_recording
from cwmav_common.progress import progress
from cwmav_rbdo.problem import load_problem
from cwmav_rbdo.result import Band, IterationRow
from cwmav_rbdo.text import iteration_header, iteration_line
from cwmav_rbdo.wing_problem import WingProblem
from cwmav_sim.spacing import bundled, change

RECORDING = Path("bags/demo")
PROBLEM = "two_variables.yaml"
_ROWS = (
    ("F", "Hz", "flapping_frequency"),
    ("AoA", "deg", "angle_of_attack"),
    ("U", "m/s", "forward_velocity"),
)
START = 120.0  # s for a node to offer its services on a busy machine
CHECK = "smoke"

cli = app("cwmav-demo", "Three nodes, one recording, one optimisation, one check.")


@cli.command()
def demo(
    live: Annotated[bool, typer.Option("--live", help="Simulate every point; no lift table.")] = False,
    problem: Annotated[
        str, typer.Option(help="Problem file, or the name of a bundled one.")
    ] = "two_variables.yaml",
    recording: Annotated[Path, typer.Option(help="Recording that the rig replays.")] = RECORDING,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 1,
    runs: Annotated[Path, typer.Option(help="Folder of the run folders.")] = Path("runs"),
) -> None:
    """Run the demo."""
    task = load_problem(problem)
    if not isinstance(task, WingProblem) or task.evaluate != "ros":
        raise InputError(f"{problem}: the demo needs kind: lift_to_power and evaluate: ros")
    if not recording.exists():
        raise InputError(f"{recording}: no such recording; run the demo in the checkout or name one")
    try:
        from cwmav_rbdo.ros.session import Client, NodeProcesses, free_domain
    except ImportError as error:
        raise InputError(f"ROS 2 is not installed here ({error}); `make setup` installs it") from None
    domain = free_domain()
    with NodeProcesses(domain) as nodes, Client(domain, nodes.check) as client:
        nodes.start("cwmav_rig", "rig_node", {"recording": recording})
        nodes.start("cwmav_sim", "sim_node", {"fidelity": CHECK if live else "table"})
        nodes.start("cwmav_rbdo", "optimiser_node", {"run_root": runs})
        _show_rig(client, recording)
        _show_sim(client, live)
        result = _optimise(client, task, problem, seed)
        _check_live(client, result)
        if not live:
            for spacing in ("12 mm", "4 mm"):
                _say(f"          {change(bundled(spacing), bundled('8 mm'))}")
        _say(f"report    {Path(result.run_folder) / 'report.html'}")


def _show_rig(client: Any, recording: Path) -> None:
    from cwmav_msgs.srv import EstimateUncertainty

    estimate = client.call(EstimateUncertainty, "/rig/estimate_uncertainty", START).estimate
    with open_recording(recording) as opened:
        begin, end = opened.span_ns
    kind = "synthetic" if estimate.synthetic else "measured"
    _say(f"rig   {recording} ({kind}, {1e-9 * (end - begin):.0f} s)   {estimate.cycles} cycles")
    for index, (name, unit, field) in enumerate(_ROWS):
        factor = math.degrees(1.0) if unit == "deg" else 1.0
        mean, std = (factor * getattr(estimate, f"{field}_{part}") for part in ("mean", "std"))
        low, high = (factor * float(value) for value in getattr(estimate, f"{field}_std_interval"))
        _say(
            f"      {name:<5} {mean:7.2f} +- {std:.3f} {unit:<4} [{low:.3f}, {high:.3f}]   "
            f"{estimate.distribution[index]}"
        )


def _show_sim(client: Any, live: bool) -> None:
    if live:
        _say(f"sim   live SPH runs, preset {CHECK}")
        return
    from cwmav_msgs.msg import ControlPoint
    from cwmav_msgs.srv import EvaluateLift

    middle = ControlPoint(flapping_frequency=16.0, angle_of_attack=math.radians(15.0), forward_velocity=3.0)
    answer = client.call(EvaluateLift, "/sim/evaluate_lift", START, point=middle, fidelity="table")
    _say(f"sim   {answer.source}")


def _optimise(client: Any, task: WingProblem, problem: str, seed: int) -> Any:
    from cwmav_msgs.action import Optimise

    seen: set[int] = set()

    def show(feedback: Any) -> None:
        row = feedback.iteration
        if row.evaluations and row.iteration not in seen:
            seen.add(row.iteration)
            _say(iteration_line(row_of(task, row)))

    _say(iteration_header(task))
    result = client.act(Optimise, "/optimiser/optimise", START, show, problem=problem, seed=seed)
    design = json.loads(result.result_json)["design"]
    units = dict(zip(task.names, task.units, strict=True))
    setting = "   ".join(f"{name} {value:.4g} {units[name]}" for name, value in design.items())
    low, high = result.reliability_interval
    _say(
        f"optimum   {setting}   L/P {result.lift_to_power:.4f} +- {result.lift_to_power_std:.4f} N/W   "
        f"reliability {result.reliability:.4f} [{low:.4f}, {high:.4f}]"
    )
    _say(f"status    {result.message}; {result.evaluations} points evaluated")
    return result


def row_of(task: WingProblem, message: Any) -> IterationRow:
    """Turn an iteration message back into the row it was made of, as far as the table shows it."""

    def design(point: Any) -> np.ndarray:
        values = {
            "F": point.flapping_frequency,
            "AoA": math.degrees(point.angle_of_attack),
            "U": point.forward_velocity,
        }
        return np.array([values[name] for name in task.names])

    low, high = message.reliability_interval
    return IterationRow(
        iteration=message.iteration,
        names=task.names,
        x=design(message.design),
        prediction=message.lift_to_power,
        prediction_std=message.lift_to_power_std,
        response=message.lift_to_power / (1.0 + message.error_percent / 100.0),
        response_std=math.nan,
        mse=message.mse,
        max_mse=message.max_mse,
        reliability=Band(message.reliability, message.reliability_std, low, high, ""),
        feasible=True,
        window_lower=design(message.window_lower),
        window_upper=design(message.window_upper),
        evaluations=message.evaluations,
        converged=message.converged,
    )


def _check_live(client: Any, result: Any) -> None:
    """Simulate the optimum, whatever its lift came from, and set it beside the prediction."""
    from cwmav_msgs.action import Simulate
    from cwmav_msgs.srv import EvaluatePower

    name = f"live SPH run ({CHECK})"
    with progress(1.0, f"check     {name}") as bar:

        def show(feedback: Any) -> None:
            note = f"cycle {feedback.cycle} of {feedback.cycles}, {feedback.seconds_left:.0f} s left"
            bar.advance_to(feedback.fraction, note)

        run = client.act(Simulate, "/sim/simulate", START, show, point=result.design, fidelity=CHECK)
    power = client.call(EvaluatePower, "/rig/evaluate_power", START, point=result.design)
    ratio = run.lift / power.power
    std = (
        abs(ratio) * math.hypot(run.lift_std / run.lift, power.power_std / power.power)
        if run.lift
        else math.nan
    )
    _say(
        f"check     {name}   lift {run.lift:.4f} +- {run.lift_std:.4f} N, power {power.power:.3f} W   "
        f"L/P {ratio:.4f} +- {std:.4f} N/W"
    )
    _say(f"          {run.source}")
    (Path(result.run_folder) / "check.json").write_text(run.result_json + "\n", encoding="utf-8")


def _say(line: str) -> None:
    typer.echo(line)


main = main_guard(cli)

if __name__ == "__main__":
    main()
