# SPDX-License-Identifier: Apache-2.0
"""Command line of the optimiser: ``cwmav-rbdo``."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from cwmav_common.cli import app, emit, main_guard, message
from cwmav_common.errors import InputError, WorkError

cli = app("cwmav-rbdo", "Reliability-based design optimisation: the wing study, and problems given as files.")

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of everything random.")]


@cli.callback()
def main_callback() -> None:
    """Reliability-based design optimisation."""


@cli.command()
def run(
    problem: Annotated[Path, typer.Argument(help="Problem file, or the name of a bundled one.")],
    seed: Seed = 0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the newest unfinished run of this problem.")
    ] = False,
    evaluate: Annotated[
        str, typer.Option(help="Who evaluates a wing study instead: ros, local or table.")
    ] = "",
    workers: Annotated[
        int,
        typer.Option(min=0, help="Points at once, in processes of their own; 0: as the problem says."),
    ] = 0,
    cluster: Annotated[
        str, typer.Option(help="Address of a dask.distributed scheduler that evaluates instead.")
    ] = "",
    runs: Annotated[Path, typer.Option(help="Folder of the run folders.")] = Path("runs"),
    as_json: Json = False,
) -> None:
    """Solve a problem."""
    from cwmav_rbdo.executors import with_evaluation
    from cwmav_rbdo.problem import Problem, load_problem
    from cwmav_rbdo.run_folder import RunFolder
    from cwmav_rbdo.study import run_study
    from cwmav_rbdo.text import iteration_header, iteration_line, summary_lines
    from cwmav_rbdo.wing_problem import EVALUATORS, WingProblem

    task: Problem = load_problem(problem)
    if evaluate:
        if evaluate not in EVALUATORS or not isinstance(task, WingProblem):
            raise InputError(f"--evaluate {evaluate}: allowed for a wing study: {', '.join(EVALUATORS)}")
        task = replace(task, evaluate=evaluate)
    task = with_evaluation(task, workers, cluster)
    if resume:
        folder = RunFolder.unfinished(runs, task.id)
        seed = int(folder.read_config()["seed"])
    else:
        folder = RunFolder.create(runs, task.id)
    message(f"run       {folder.path}")
    with ExitStack() as stack:
        evaluator = noise = None
        if isinstance(task, WingProblem):
            message(iteration_header(task))
            if task.evaluate == "ros" and not cluster:
                from cwmav_rbdo.ros_access import connect

                evaluator, noise = stack.enter_context(connect(task, measure=not resume))
        result = run_study(
            task,
            evaluator,
            seed=seed,
            run_folder=folder,
            resume=resume,
            noise=noise,
            on_iteration=lambda row: message(iteration_line(row)),
        )
    report = [f"report    {folder.report}"] if folder.report.exists() else []
    emit(result.to_json() | {"run_folder": str(folder.path)}, as_json, [*summary_lines(result), *report])


@cli.command()
def reliability(
    problem: Annotated[Path, typer.Argument(help="Problem file of kind 'reliability'.")],
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Estimate the failure probability of a problem without design variables."""
    from cwmav_rbdo.problem import load_problem
    from cwmav_rbdo.study import run_study

    task = load_problem(problem)
    if task.kind != "reliability":
        raise InputError(
            f"{problem}: kind is '{task.kind}'; allowed here: reliability (others: cwmav-rbdo run)"
        )
    result = run_study(task, seed=seed).to_json()
    keys = ("id", "pf", "pf_std", "beta", "true_evaluations", "method", "seed", "converged", "message")
    emit(
        {key: result[key] for key in keys},
        as_json,
        [
            f"failure probability {result['pf']:.5g} +- {result['pf_std']:.2g}, beta {result['beta']:.4f}, "
            f"{result['true_evaluations']} evaluations, {result['method']}",
            *([] if result["converged"] else [result["message"]]),
        ],
    )


@cli.command()
def benchmark(
    name: Annotated[str, typer.Argument(help="One published problem; none: all of them.")] = "",
    list_only: Annotated[bool, typer.Option("--list", help="Only list the names.")] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Solve published problems and compare with their brute-force optima; status 1 when one is missed."""
    from cwmav_common.progress import progress
    from cwmav_rbdo.benchmarks import benchmark_names, benchmark_problem, run_benchmark

    names = benchmark_names()
    if list_only:
        emit({"names": names}, as_json, names)
        return
    if name:
        names = [benchmark_problem(name).id]
    rows = []
    with progress(len(names), "benchmark", "problem") as bar:
        for each in names:
            rows.append(run_benchmark(each, seed))
            bar.update(1, each)
    single = rows[0] if name else None
    lines = [
        f"{row.name:28} {row.objective:12.6g}  reference {row.reference_objective:12.6g}  "
        f"{row.true_evaluations:4d} of {row.allowed_evaluations} evaluations  "
        f"{'passed' if row.passed else 'MISSED'} {row.error}".rstrip()
        for row in rows
    ]
    emit(
        vars(single) if single else {"problems": rows, "passed": all(r.passed for r in rows)}, as_json, lines
    )
    missed = [row.name for row in rows if not row.passed]
    if missed:
        raise WorkError(f"missed: {', '.join(missed)}")


@cli.command()
def evidence(
    out: Annotated[Path, typer.Option(help="Folder of the runs, the table and the figure.")],
    seeds: Annotated[int, typer.Option(min=1, max=10_000, help="Runs of every method.")] = 30,
    study: Annotated[list[str] | None, typer.Option(help="Only these studies.")] = None,
    as_json: Json = False,
) -> None:
    """Compare methods by true evaluations to the optimum; continues what the folder holds."""
    from cwmav_rbdo.evidence import collect, summarise, table_lines, write_figure
    from cwmav_rbdo.evidence.collect import read

    path = out / "evidence.jsonl"
    collect(path, seeds, study or (), message)
    rows = read(path)
    table = list(table_lines(rows))
    (out / "evidence.md").write_text("\n".join(table) + "\n", encoding="utf-8")
    write_figure(rows, out / "evidence.png")
    emit({"rows": summarise(rows)}, as_json, table)


@cli.command()
def reproduce(
    table: Annotated[str, typer.Argument(help="table1, table3, table5, table6, table7 or all.")],
    cases: Annotated[Path | None, typer.Option(help="CSV of simulated lifts, for tables 1 and 3.")] = None,
    simulate: Annotated[
        Path | None, typer.Option(help="Run the rows of tables 1 and 3 now; their folder, resumable.")
    ] = None,
    preset: Annotated[str, typer.Option(help="Preset of the runs of --simulate.")] = "coarse",
    assignments: Annotated[
        list[str] | None,
        typer.Option("--set", help="Change a setting of those runs, e.g. --set wing.model=lattice."),
    ] = None,
    incidence_offset: Annotated[
        float,
        typer.Option(
            min=-15.0, max=15.0, help="Added to every angle of attack of table 3 [deg], one for all rows."
        ),
    ] = 0.0,
    seed: Seed = 0,
    seeds: Annotated[int, typer.Option(min=1, max=1000, help="Runs that the counts are taken over.")] = 30,
    keep: Annotated[
        Path | None, typer.Option(help="Folder that keeps the runs of tables 5 to 7; none there is repeated.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Put the paper's tables beside ours, with every decision named."""
    from cwmav_rbdo.reproduction import report
    from cwmav_rbdo.reproduction.simulated import Runs, simulate_rows

    names = report.chosen(table)
    if cases is not None and simulate is not None:
        raise InputError("--cases and --simulate exclude each other: lifts are read or run")
    if assignments and simulate is None:
        raise InputError("--set changes the runs of --simulate; add --simulate DIR")
    if incidence_offset and "table3" not in names:
        raise InputError("--incidence-offset changes the angles of table 3; allowed with: table3, all")
    runs = None if simulate is None else Runs(simulate, preset, tuple(assignments or ()), incidence_offset)
    if runs is not None:
        cases = simulate_rows(names, runs, lambda k, n, what: message(f"{k}/{n}  {what}"))
    found = report.reproduce(names, cases, seed, seeds, keep, incidence_offset)
    if runs is not None:
        found["runs"] = runs.describe()
    emit(found, as_json, report.lines(found))


main = main_guard(cli)

if __name__ == "__main__":
    main()
