# SPDX-License-Identifier: Apache-2.0
"""The program ``cwmav-sim``: lift of clapping wings from the command line."""

from __future__ import annotations

import logging
import sys
import time
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from cwmav_common.cli import app, emit, main_guard, message
from cwmav_common.errors import InputError, WorkError
from cwmav_common.progress import Progress as Bar
from cwmav_common.progress import progress
from cwmav_sim import case as cases
from cwmav_sim.case import Case
from cwmav_sim.result import LiftResult, describe_point
from cwmav_sim.text import check_lines, result_lines
from cwmav_sim.verification.protocol import Check

cli = app("cwmav-sim", "Lift of clapping wings by smoothed particle hydrodynamics.")

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
Preset = Annotated[str, typer.Option(help=f"Settings to start from: {', '.join(cases.presets())}.")]
Set = Annotated[
    list[str] | None, typer.Option("--set", help="Change a setting, e.g. --set flow.resolution.dp=0.01.")
]
Device = Annotated[str, typer.Option(help="Where to compute: cpu or cuda.")]


@cli.command()
def run(
    frequency: Annotated[float | None, typer.Option("-F", help="Flapping frequency [Hz], 4..30.")] = None,
    angle: Annotated[float | None, typer.Option("-A", help="Angle of attack [deg], -10..60.")] = None,
    airspeed: Annotated[float | None, typer.Option("-U", help="Forward velocity [m/s], 0..6.")] = None,
    preset: Preset = "smoke",
    case_file: Annotated[
        Path | None, typer.Option("--case", help="Settings from a YAML file instead of a preset.")
    ] = None,
    assignments: Set = None,
    device: Device = "cpu",
    out: Annotated[Path | None, typer.Option(help="Folder for result, history, settings, snapshots.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the checkpoint in --out.")] = False,
    keep_state: Annotated[
        bool, typer.Option("--keep-state", help="Leave the air at the end in --out, for --start-from.")
    ] = False,
    start_from: Annotated[
        Path | None,
        typer.Option(help="Folder of a run with --keep-state; start from its air, wings in full motion."),
    ] = None,
    snapshots: Annotated[int, typer.Option(min=0, help="VTK snapshots per flapping cycle in --out.")] = 0,
    picture: Annotated[Path | None, typer.Option(help="Draw lift and vorticity into this file.")] = None,
    animation: Annotated[
        Path | None, typer.Option(help="Film the vorticity of the last cycle (.gif, or .mp4 with ffmpeg).")
    ] = None,
    json: Json = False,
) -> None:
    """Simulate one operating point and report its mean lift."""
    from cwmav_sim import run as running
    from cwmav_sim.animation import animate as animate_slices
    from cwmav_sim.animation import check_ending
    from cwmav_sim.devices import check_device
    from cwmav_sim.export import Snapshots
    from cwmav_sim.picture import FilmObserver, SliceObserver, draw
    from cwmav_sim.warm import EndState, started

    check_device(device)
    case = _case(preset, case_file, assignments, (frequency, angle, airspeed))
    start = EndState.read(start_from) if start_from else None
    if start is not None:
        case = started(case, start)
    if keep_state and out is None:
        raise InputError("--keep-state needs a folder; add --out DIR")
    if snapshots and out is None:
        raise InputError("--snapshots needs a folder; add --out DIR")
    if resume and out is None:
        raise InputError("--resume needs the folder of the run; add --out DIR")
    observers: list[Any] = []
    slicer = SliceObserver(case) if picture else None
    film = FilmObserver(case) if animation else None
    observers += [observer for observer in (slicer, film) if observer is not None]
    if animation is not None:
        check_ending(animation)
    if snapshots and out is not None:
        observers.append(Snapshots(out, case, snapshots, resume=resume))
    _print_header(case)
    with progress(case.run.cycles, describe_point(case), "cycle") as bar:
        result = running.simulate(
            case,
            on_progress=_reporter(bar),
            out=out,
            resume=resume,
            device=device,
            observers=observers,
            start=start,
            keep_state=out if keep_state else None,
        )
    if picture is not None and slicer is not None and slicer.slice is not None:
        draw(case, result, slicer.slice, picture)
    if animation is not None and film is not None:
        animate_slices(case, film.slices, animation)
    emit(result.to_json(), json, result_lines(result))


@cli.command()
def animate(
    folder: Annotated[Path, typer.Argument(help="Folder of a run with snapshots.")],
    out: Annotated[Path | None, typer.Option(help="File (.gif, or .mp4 with ffmpeg).")] = None,
    frames_per_second: Annotated[int, typer.Option("--fps", min=1, help="Frames per second.")] = 12,
    json: Json = False,
) -> None:
    """Draw the vorticity around the wings from the snapshots of a run, one frame each."""
    from cwmav_sim.animation import animate as animate_slices
    from cwmav_sim.animation import check_ending, stored_slices

    path = out or folder / "vorticity.gif"
    check_ending(path)
    case = cases.load_case(folder / "config.yaml")
    slices = []
    with progress(len(list((folder / "vtk").glob("wings_*.vtu"))), "animate", "frame") as bar:
        for frame in stored_slices(folder, case):
            slices.append(frame)
            bar.update(1)
    animate_slices(case, slices, path, frames_per_second)
    emit({"file": path, "frames": len(slices)}, json, [f"{len(slices)} frames in {path}"])


@cli.command()
def sweep(
    table: Annotated[Path, typer.Argument(help="CSV file with columns F_hz, U_m_s, AoA_deg.")],
    out: Annotated[Path, typer.Option(help="Folder for the results; a sweep started again continues there.")],
    preset: Preset = "smoke",
    assignments: Set = None,
    device: Device = "cpu",
    workers: Annotated[
        int, typer.Option(min=1, help="Processes that share the threads of this machine.")
    ] = 1,
    cluster: Annotated[
        str, typer.Option(help="Scheduler of a dask cluster to run on instead, such as tcp://host:8786.")
    ] = "",
    start_nearest: Annotated[
        bool, typer.Option("--start-nearest", help="Start every row from the air of the nearest row before.")
    ] = False,
    json: Json = False,
) -> None:
    """Simulate many operating points, keeping every result as soon as it is there."""
    from cwmav_sim import run as running
    from cwmav_sim import runners, warm
    from cwmav_sim import sweep as sweeping
    from cwmav_sim.devices import check_device
    from cwmav_sim.store import ResultStore

    if not cluster:  # whose workers look for themselves
        check_device(device)
    base = cases.with_overrides(cases.preset(preset), assignments or [])
    points = sweeping.cases_of(base, sweeping.read_points(table))
    states = out.resolve() / "states" if start_nearest else None
    if start_nearest:
        points = warm.from_nearest(points)
    out.mkdir(parents=True, exist_ok=True)
    cases.dump_case(base, out / "config.yaml")
    results: dict[int, LiftResult] = {}

    def keep(number: int, outcome: LiftResult | sweeping.Failure) -> None:
        if isinstance(outcome, LiftResult):
            results[number] = outcome
            sweeping.write_table([results[k] for k in sorted(results)], out / "sweep.csv")
            note = f"{outcome.mean_lift:.4f} N, {outcome.wall_s:.0f} s"
        else:
            note = f"failed: {outcome.reason}"
        bar.update(1, note)
        message(f"case {number + 1} of {len(points)}  {describe_point(points[number])}  {note}")

    def has_state(case: Case) -> bool:
        return states is None or warm.EndState.there(states / case.address())

    runner: runners.Runner
    if cluster:
        runner = runners.Cluster(cluster, device, partial(runners.run_mapping, states=states))
    elif workers > 1:
        runner = runners.Processes(workers, device, partial(runners.in_worker, states=states))
    else:
        runner = runners.InProcess(
            lambda case: running.simulate(
                case,
                out=out / "runs" / case.address(),
                resume=True,
                device=device,
                **runners.kept_states(case, states),
            )
        )
    with progress(len(points), "sweep", "case") as bar, closing(runner):
        swept = sweeping.sweep(points, ResultStore(out / "store"), runner, keep, has_state)
    content = {"cases": [r.to_json() for r in swept.results], "failed": list(swept.failed)}
    done = f"{len(swept.results)} results ({swept.computed} computed now) in {out / 'sweep.csv'}"
    emit(content, json, [done])
    if swept.failed:
        raise WorkError(f"{len(swept.failed)} of {len(points)} cases failed")


@cli.command()
def points(
    out: Annotated[Path, typer.Argument(help="CSV file to write, for sweep.")],
    count: Annotated[int, typer.Option(min=2, help="Number of points.")] = 24,
    airspeed: Annotated[float | None, typer.Option("-U", help="Keep all at this airspeed [m/s].")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the Latin hypercube.")] = 1,
    json: Json = False,
) -> None:
    """Spread operating points over the design space by a Latin hypercube."""
    import numpy as np

    from cwmav_sim.sweep import COLUMNS, latin_hypercube, write_points

    spread = latin_hypercube(count, np.random.default_rng(seed), airspeed)
    write_points(spread, out)
    rows = [dict(zip(COLUMNS, (f, u, a), strict=True)) for f, a, u in spread]
    emit({"points": rows, "file": out}, json, [f"{count} points in {out}"])


@cli.command()
def table(
    out: Annotated[Path, typer.Argument(help="CSV file to write.")],
    folders: Annotated[list[Path], typer.Argument(help="Folders of sweeps with the same settings.")],
    solver: Annotated[
        str | None, typer.Option(help="Fingerprint of the solver that made them, if not this one.")
    ] = None,
    json: Json = False,
) -> None:
    """Gather finished sweeps into one lift table and tell how well it interpolates."""
    from cwmav_sim.store import ResultStore
    from cwmav_sim.sweep import write_table
    from cwmav_sim.table import LiftTable

    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"{folder}: is no folder of a sweep")
    stored = [result for folder in folders for result in ResultStore(folder / "store").everything(solver)]
    results = list({result.address: result for result in stored}.values())
    write_table(results, out)
    lifts = LiftTable.load(out)
    content = {"rows": len(results), "leave_one_out_n": lifts.loo_rms, "source": lifts.source, "file": out}
    emit(content, json, [f"{len(results)} rows in {out}", lifts.source])


@cli.command()
def verify(
    name: Annotated[str | None, typer.Argument(help="Name of one case.")] = None,
    everything: Annotated[bool, typer.Option("--all", help="Run the long cases too.")] = False,
    listing: Annotated[bool, typer.Option("--list", help="List the cases.")] = False,
    record: Annotated[
        Path | None, typer.Option(help="Keep the results in verification.json and .md of this folder.")
    ] = None,
    json: Json = False,
) -> None:
    """Compare the solver with known answers."""
    from cwmav_sim.fingerprint import coupled_fingerprint, solver_fingerprint
    from cwmav_sim.verification.catalogue import catalogue, select
    from cwmav_sim.verification.record import Record

    if listing:
        entries = [{"name": c.name, "summary": c.summary, "long": c.slow} for c in catalogue()]
        lines = [f"{e['name']:24} {'long ' if e['long'] else '     '}{e['summary']}" for e in entries]
        alone, coupled = solver_fingerprint(), coupled_fingerprint()
        emit(
            {"cases": entries, "solver": alone, "coupled_solver": coupled},
            json,
            [*lines, f"solver {alone}, with flexible wings {coupled}"],
        )
        return
    kept = Record(record) if record is not None else None
    checks: list[Check] = []
    for entry in select(name, everything):
        message(f"{entry.name}: {entry.summary}")
        started = time.perf_counter()
        found = entry.run()
        if kept is not None:
            kept.add(entry, found, time.perf_counter() - started)
        for line in check_lines(found):
            message(f"  {line}")
        checks += found
    emit({"cases": [c.to_json() for c in checks]}, json, check_lines(checks))
    failures = [c for c in checks if not c.passed]
    if failures:
        raise WorkError(f"{len(failures)} of {len(checks)} checks failed")


@cli.command()
def bench(
    particles: Annotated[
        int | None, typer.Option(min=1000, help="Number of particles, about; 100000, on a card 2100000.")
    ] = None,
    device: Device = "cpu",
    json: Json = False,
) -> None:
    """Measure the speed of the solver on this machine."""
    from cwmav_sim import benchmark
    from cwmav_sim.devices import check_device

    check_device(device)
    figures: benchmark.Figures | benchmark.CardFigures
    if device == "cuda":
        figures = benchmark.measure_card(particles or 2_100_000)
    else:
        figures = benchmark.measure(particles or 100_000)
    emit(figures.to_json(), json, figures.lines())


def _case(
    preset: str,
    case_file: Path | None,
    assignments: list[str] | None,
    point: tuple[float | None, float | None, float | None],
) -> Case:
    base = cases.load_case(case_file) if case_file is not None else cases.preset(preset)
    base = cases.with_overrides(base, assignments or [])
    frequency, angle, airspeed = point
    return base.at(
        base.flapping_frequency if frequency is None else frequency,
        base.angle_of_attack_deg if angle is None else angle,
        base.airspeed if airspeed is None else airspeed,
    )


def _print_header(case: Case) -> None:
    """Say every setting before the work starts, where a person is looking."""
    from cwmav_sim.run import header

    if sys.stderr.isatty():
        for line in header(case):
            message(line)
    else:
        logging.getLogger(__name__).debug("%s", "\n".join(header(case)))


def _reporter(bar: Bar) -> Any:
    def report(state: Any) -> None:
        note = f"cycle {state.cycle} of {state.cycles}, {state.seconds_left:.0f} s left"
        bar.advance_to(state.fraction * state.cycles, note)

    return report


main = main_guard(cli)
