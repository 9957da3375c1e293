# SPDX-License-Identifier: Apache-2.0
"""``cwmav-rig``: synthesise recordings, look into them, estimate uncertainties, build the power model."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from cwmav_common.cli import app, emit, main_guard, message
from cwmav_common.errors import InputError, WorkError
from cwmav_common.progress import progress
from cwmav_common.settings import from_mapping, override
from cwmav_rig.angle.command import register as register_angle

cli = app("cwmav-rig", "Recordings of the rig: synthesise, inspect, estimate uncertainties, model the power.")
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]


@cli.command()
def synthesise(
    out: Annotated[Path, typer.Option(help="An .mcap file, or a name without suffix for a rosbag2 folder.")],
    frequency: Annotated[float, typer.Option("-F", help="Flapping frequency [Hz].")],
    angle: Annotated[float, typer.Option("-A", help="Angle of attack [deg].")],
    airspeed: Annotated[float, typer.Option("-U", help="Airspeed [m/s].")],
    seconds: Annotated[float, typer.Option(help="Length [s].")] = 30.0,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
    power_model: Annotated[str, typer.Option(help="physical or paper_law.")] = "physical",
    artefact: Annotated[list[str] | None, typer.Option(help="name=value, may be repeated.")] = None,
    assign: Annotated[list[str] | None, typer.Option("--set", help="Any other setting, key=value.")] = None,
    as_json: Json = False,
) -> None:
    """Write a recording from the physical model, marked synthetic, with its truth inside."""
    from cwmav_rig import synthesise as synthesis
    from cwmav_rig.synthesis_settings import Synthesis

    values = {
        "flapping_frequency": frequency,
        "angle_of_attack_deg": angle,
        "airspeed": airspeed,
        "seconds": seconds,
        "seed": seed,
        "power_model": power_model,
    }
    settings = from_mapping(Synthesis, values, "cwmav-rig synthesise")
    settings = override(settings, [f"artefacts.{item}" for item in artefact or []], "--artefact")
    settings = override(settings, assign or [], "--set")
    truth = synthesis.synthesise(out, settings)
    plain = synthesis.truth_mapping(truth)
    emit(
        {"bag": str(out), "synthetic": True, "truth": plain},
        as_json,
        [f"{out}: synthetic, {seconds:g} s, {truth.cycles} cycles, seed {seed}"]
        + [f"  {name}: {value}" for name, value in plain.items()],
    )


@cli.command()
def info(
    bag: Annotated[Path, typer.Argument(help="An .mcap file or a rosbag2 folder.")],
    as_json: Json = False,
) -> None:
    """Say what a recording holds."""
    from cwmav_rig.info import describe

    found = describe(bag)
    emit(found.to_json(), as_json, found.lines())


@cli.command()
def uncertainty(
    bag: Annotated[Path, typer.Argument(help="An .mcap file or a rosbag2 folder.")],
    topics: Annotated[Path | None, typer.Option(help="Topic map (YAML).")] = None,
    window: Annotated[tuple[float, float] | None, typer.Option(help="Begin and end [s].")] = None,
    budget: Annotated[bool, typer.Option("--budget", help="Also print the uncertainty budgets.")] = False,
    as_json: Json = False,
) -> None:
    """Estimate the scatter of F, AoA, U, lift and power with 95 % intervals."""
    from cwmav_rig.analysis import analyse
    from cwmav_rig.text import budget_lines, report_lines
    from cwmav_rig.topic_map import load_topic_map

    report = analyse(bag, load_topic_map(topics) if topics else None, window=window)
    for problem in report.problems:
        message(problem)
    lines = [*report_lines(report), *(budget_lines(report) if budget else ())]
    emit(report.to_json(), as_json, lines)


@cli.command()
def plot(
    bag: Annotated[Path, typer.Argument(help="An .mcap file or a rosbag2 folder.")],
    out: Annotated[Path, typer.Option(help="Folder for pictures and tables.")],
    topics: Annotated[Path | None, typer.Option(help="Topic map (YAML).")] = None,
    window: Annotated[tuple[float, float] | None, typer.Option(help="Begin and end [s].")] = None,
    as_json: Json = False,
) -> None:
    """Draw spectra, densities, cycles, phase averages and correlations of a recording; write the tables."""
    from cwmav_rig.analysis import study
    from cwmav_rig.plots import write_all
    from cwmav_rig.topic_map import load_topic_map

    found = study(bag, load_topic_map(topics) if topics else None, window=window)
    for problem in found.report.problems:
        message(problem)
    written = [str(path) for path in write_all(found, out)]
    emit({"bag": str(bag), "files": written, "synthetic": found.report.synthetic}, as_json, written)


@cli.command("settings")
def settings_command() -> None:
    """Print every setting of topic maps, benches, synthetic recordings and the node, as Markdown tables."""
    from cwmav_rig.reference import page

    print(page(), end="")


@cli.command()
def replay(
    bag: Annotated[Path, typer.Argument(help="An .mcap file or a rosbag2 folder.")],
    topics: Annotated[Path | None, typer.Option(help="Topic map (YAML).")] = None,
    start: Annotated[float, typer.Option(help="Where to begin [s].", min=0.0)] = 0.0,
    as_json: Json = False,
) -> None:
    """Replay in lock step, faster than real time: every cycle and the report as the node would give them.

    The same recording gives the same output every time, whatever the load of the machine.
    """
    from cwmav_common.mcap_reader import open_recording
    from cwmav_rig.live import CycleEvent, run_in_lock_step
    from cwmav_rig.replay import Player
    from cwmav_rig.text import report_lines
    from cwmav_rig.topic_map import load_topic_map, resolve

    events: list[CycleEvent] = []
    with open_recording(bag) as recording:
        mapped = resolve(recording, load_topic_map(topics) if topics else None)
        with Player(recording, start_offset=start) as player:
            report = run_in_lock_step(player, mapped, events.append).report()
    for problem in report.problems:
        message(problem)
    cycles = [{"stamp_ns": e.stamp_ns, "flapping_frequency_hz": e.frequency} for e in events]
    lines = [f"{e.stamp_ns * 1e-9:.6f} s  {e.frequency:.4f} Hz" for e in events]
    emit(
        {"bag": str(bag), "cycles": cycles, "report": report.to_json()},
        as_json,
        [*lines, *report_lines(report)],
    )


@cli.command()
def record(
    bench: Annotated[Path, typer.Argument(help="Which instruments are on the bench (YAML).")],
    out: Annotated[Path, typer.Option(help="An .mcap file, or a name without suffix for a rosbag2 folder.")],
    seconds: Annotated[float, typer.Option(help="How long; 0 until interrupted.", min=0.0)] = 0.0,
    as_json: Json = False,
) -> None:
    """Record live instruments without ROS: force, oscilloscope, camera, tunnel."""
    from cwmav_rig.instruments import load_bench
    from cwmav_rig.record import record_bench

    with progress(10.0 * seconds or math.inf, "recording", "0.1 s") as bar:
        health, messages = record_bench(load_bench(bench), out, seconds, lambda: bar.update(1))
    rows = [
        {"name": h.name, "identity": h.identity, "samples": h.received, "lost": h.lost, "dropped": h.dropped}
        for h in health
    ]
    lines = [f"{r['name']:13s} {r['samples']} samples, {r['lost']} lost   {r['identity']}" for r in rows]
    result = {"bag": str(out), "instruments": rows, "messages": messages}
    emit(result, as_json, [f"{out}: {messages} messages", *lines])
    failed = "; ".join(h.message for h in health if h.state == "error")
    if failed:
        raise WorkError(f"{failed}; what came until then is in {out}")


@cli.command()
def campaign(
    out: Annotated[Path, typer.Option(help="Folder for the recordings.")],
    points: Annotated[int, typer.Option(help="Points inside, besides the outer ones.")] = 32,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
    model: Annotated[Path | None, typer.Option(help="Also write the power model of them here.")] = None,
    assign: Annotated[list[str] | None, typer.Option("--set", help="Any other setting, key=value.")] = None,
    as_json: Json = False,
) -> None:
    """Synthesise operating points over the design space for the power surrogate."""
    from cwmav_rig.campaign import Campaign, design, record
    from cwmav_rig.power_model import PowerModel

    values = {"points": points, "seed": seed}
    settings = override(from_mapping(Campaign, values, "cwmav-rig campaign"), assign or [], "--set")
    total = len(design(settings))
    with progress(total, "recording", "bag") as bar:
        paths = record(out, settings, lambda path: bar.update(1))
    result: dict[str, object] = {"folder": str(out), "bags": [str(path) for path in paths], "synthetic": True}
    lines = [f"{out}: {total} synthetic recordings, seed {seed}"]
    if model is not None:
        result["model"] = str(model)
        fitted = PowerModel.from_recordings(paths)
        fitted.save(model)
        errors = fitted.leave_one_out()
        result["leave_one_out_rms"] = float((errors**2).mean() ** 0.5)
        lines.append(f"{model}: power model, leave-one-out error {result['leave_one_out_rms']:.2%} rms")
    emit(result, as_json, lines)


@cli.command("power")
def power_command(
    model: Annotated[Path, typer.Argument(help="A power model, or a folder of recordings.")],
    frequency: Annotated[float, typer.Option("-F", help="Flapping frequency [Hz].")],
    angle: Annotated[float, typer.Option("-A", help="Angle of attack [deg].")],
    airspeed: Annotated[float, typer.Option("-U", help="Airspeed [m/s].")],
    as_json: Json = False,
) -> None:
    """Predict the electrical power at a setting from recorded operating points."""
    from cwmav_rig.power_model import PowerModel

    if not model.exists():
        raise InputError(f"{model}: no such power model or folder of recordings")
    fitted = PowerModel.load(model) if model.suffix == ".json" else PowerModel.from_recordings([model])
    answer = fitted.predict(frequency, math.radians(angle), airspeed)
    emit(
        {
            "power_w": answer.power,
            "power_std_w": answer.power_std,
            "inside": answer.inside,
            "source": answer.source,
        },
        as_json,
        [f"{answer.power:.4f} +- {answer.power_std:.4f} W   {answer.source}"],
    )


register_angle(cli)
main = main_guard(cli)

if __name__ == "__main__":
    main()
