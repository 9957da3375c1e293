# SPDX-License-Identifier: Apache-2.0
"""Files of one run: result, history, settings, and VTK time series that ParaView opens."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import meshio  # type: ignore[import-untyped]
import numpy as np

from cwmav_common.cli import to_json
from cwmav_common.errors import InputError, WorkError
from cwmav_sim.case import Case, dump_case
from cwmav_sim.gauges import History
from cwmav_sim.phases import draw_phases, phase_averages, write_phases
from cwmav_sim.result import LiftResult, describe_point
from cwmav_sim.sph.sheet import Nodes
from cwmav_sim.views import ParticleView
from cwmav_sim.wing.sheet import SheetMotion


def write_run(folder: Path, case: Case, result: LiftResult) -> None:
    """Write ``result.json``, ``config.yaml``, ``history.csv``, ``phases.csv`` and ``phases.png``.

    Raises
    ------
    WorkError
        When the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "result.json").write_text(to_json(result.to_json()) + "\n", encoding="utf-8")
        dump_case(case, folder / "config.yaml")
        if result.history is not None:
            write_history(result.history, case.prescribed().panel_names, folder / "history.csv")
            averages = phase_averages(result.history, case.flapping_frequency, case.run.discard)
            write_phases(averages, folder / "phases.csv")
            draw_phases(averages, f"{describe_point(case)}   {result.source()}", folder / "phases.png")
    except OSError as error:
        raise WorkError(f"{folder}: the run cannot be written ({error})") from None


def write_history(history: History, panels: tuple[str, ...], path: Path) -> None:
    """Write forces against time as CSV: vehicle totals, then parts and moment of every panel."""
    columns = ["time_s", "lift_n", "drag_n", "pitch_moment_n_m", "power_w"]
    data = [history.time, history.lift(), history.drag(), history.pitch_moment(), history.total_power()]
    parts = (
        ("pressure", history.pressure, "n"),
        ("viscous", history.viscous, "n"),
        ("inertial", history.inertial, "n"),
        ("moment", history.moment, "n_m"),
    )
    for number, panel in enumerate(panels):
        for part, values, unit in parts:
            for axis, name in enumerate("xyz"):
                columns.append(f"{panel}_{part}_{name}_{unit}")
                data.append(values[:, number, axis])
        columns.append(f"{panel}_power_w")
        data.append(history.power[:, number])
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([f"{value:.8g}" for value in row] for row in np.column_stack(data))


class Snapshots:
    """VTK files of wings and particles at equal intervals, indexed by two ``.pvd`` files.

    Parameters
    ----------
    folder : Path
        Receives ``wings.pvd``, ``particles.pvd`` and the folder ``vtk``.
    case : Case
        The run.
    per_cycle : int
        Snapshots in every flapping cycle.
    resume : bool
        Keep the snapshots that an interrupted run left, as far as it is continued from.
    """

    def __init__(self, folder: Path, case: Case, per_cycle: int, *, resume: bool = False) -> None:
        self._folder = folder
        self._motion = case.motion()
        self._interval = 1.0 / (per_cycle * case.flapping_frequency)
        self._times = [t for t, _ in read_index(folder / "wings.pvd")] if resume else []
        (folder / "vtk").mkdir(parents=True, exist_ok=True)

    def __call__(self, view: ParticleView) -> None:
        """Write a snapshot when the next one is due."""
        while self._times and self._times[-1] >= view.time:  # of a run that was continued from before
            self._times.pop()
        if view.time < len(self._times) * self._interval:
            return
        number = len(self._times)
        self._times.append(view.time)
        if view.sheet is not None:
            wing_mesh(self._motion, view.sheet).write(self._path("wings", number))
        particle_mesh(view).write(self._path("particles", number))
        for name in ("wings", "particles"):
            self._write_index(name)

    def _path(self, name: str, number: int) -> Path:
        return self._folder / "vtk" / f"{name}_{number:04d}.vtu"

    def _write_index(self, name: str) -> None:
        entries = [
            f'    <DataSet timestep="{time:.9g}" file={quoteattr(f"vtk/{name}_{number:04d}.vtu")}/>'
            for number, time in enumerate(self._times)
        ]
        text = ['<VTKFile type="Collection" version="0.1">', "  <Collection>", *entries]
        text += ["  </Collection>", "</VTKFile>", ""]
        (self._folder / f"{name}.pvd").write_text("\n".join(text), encoding="utf-8")


def read_index(path: Path) -> list[tuple[float, Path]]:
    """Return times [s] and files of a ``.pvd`` index; nothing where there is none.

    Raises
    ------
    InputError
        When the file is no such index.
    """
    if not path.exists():
        return []
    try:
        entries = ElementTree.parse(path).getroot().iter("DataSet")  # noqa: S314 - our own file
        return [(float(e.attrib["timestep"]), path.parent / e.attrib["file"]) for e in entries]
    except (OSError, ElementTree.ParseError, KeyError, ValueError) as error:
        raise InputError(f"{path}: is no index of VTK files ({error})") from None


def wing_mesh(motion: SheetMotion, nodes: Nodes) -> Any:
    """Return the wings at one instant as a mesh with panel numbers, velocities and accelerations."""
    return meshio.Mesh(
        nodes.x,
        [("triangle", motion.triangles)],
        point_data={"velocity": nodes.v, "acceleration": nodes.a},
        cell_data={"panel": [motion.panel]},
    )


def particle_mesh(view: ParticleView) -> Any:
    """Return the particles as a mesh of points with velocity, density and pressure."""
    count = len(view.position)
    return meshio.Mesh(
        view.position,
        [("vertex", np.arange(count).reshape(-1, 1))],
        point_data={"velocity": view.velocity, "density": view.density, "pressure": view.pressure},
    )
