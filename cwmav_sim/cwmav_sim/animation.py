# SPDX-License-Identifier: Apache-2.0
"""Animations of the vorticity around the wings, from a run in progress or from its stored snapshots."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import meshio  # type: ignore[import-untyped]
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.figure import Figure

from cwmav_common.errors import InputError, WorkError
from cwmav_sim.case import Case
from cwmav_sim.export import read_index
from cwmav_sim.picture import FlowSlice, draw_slice, take_slice
from cwmav_sim.result import describe_point
from cwmav_sim.wing.sheet import FloatArray

_DPI = 100


@dataclass(frozen=True)
class StoredFlow:
    """Particles of one snapshot."""

    time: float
    position: FloatArray
    velocity: FloatArray


def stored_slices(folder: Path, case: Case) -> Iterator[FlowSlice]:
    """Give a slice for every snapshot in the folder of a run.

    Raises
    ------
    InputError
        When the folder holds no snapshots, or one cannot be read.
    """
    wings, particles = (read_index(folder / f"{name}.pvd") for name in ("wings", "particles"))
    if not wings or not particles:
        raise InputError(f"{folder}: holds no snapshots; run with --snapshots N --out {folder}")
    for (time, wing_file), (_, particle_file) in zip(wings, particles, strict=False):
        wing, cloud = _read(wing_file), _read(particle_file)
        corners = np.asarray(wing.points, dtype=np.float64)[wing.cells_dict["triangle"]]
        flow = StoredFlow(time, np.asarray(cloud.points), np.asarray(cloud.point_data["velocity"]))
        yield take_slice(case, corners, flow)


def _read(path: Path) -> meshio.Mesh:
    try:
        return meshio.read(path)
    except Exception as error:  # the reader raises whatever its parser does
        raise InputError(f"{path}: cannot be read as VTK ({error})") from None


def animate(case: Case, slices: Sequence[FlowSlice], path: Path, frames_per_second: int = 12) -> None:
    """Draw slices one after the other, all with the same colours.

    Parameters
    ----------
    case : Case
        The run.
    slices : sequence of FlowSlice
        Frames in order.
    path : Path
        ``.gif``, or ``.mp4`` where ffmpeg is installed.
    frames_per_second : int
        Speed of the animation.

    Raises
    ------
    InputError
        When there are no frames, or for another ending of the file.
    WorkError
        When the file cannot be written.
    """
    writer = _writer(path, frames_per_second)
    if not slices:
        raise InputError(f"{path}: there is nothing to animate (no frame)")
    limit = float(np.percentile(np.abs([s.vorticity for s in slices]), 99.0)) or 1.0
    figure = Figure(figsize=(6.4, 5.0), layout="constrained")
    try:
        with writer.saving(figure, str(path), _DPI):
            for flow in slices:
                figure.clear()
                draw_slice(figure.subplots(), case, flow, limit)
                cycles = flow.time * case.flapping_frequency
                figure.suptitle(f"{describe_point(case)}   {cycles:.2f} cycles", fontsize="medium")
                writer.grab_frame()
    except OSError as error:
        raise WorkError(f"{path}: the animation cannot be written ({error})") from None


def check_ending(path: Path) -> None:
    """Refuse a file that no animation can be written to, before the work starts.

    Raises
    ------
    InputError
        Says which endings are allowed.
    """
    _writer(path, 1)


def _writer(path: Path, frames_per_second: int) -> AbstractMovieWriter:
    if path.suffix == ".gif":
        return PillowWriter(fps=frames_per_second)
    if path.suffix == ".mp4":
        if not FFMpegWriter.isAvailable():
            raise InputError(f"{path}: .mp4 needs ffmpeg, which is not installed; allowed: .gif")
        return FFMpegWriter(fps=frames_per_second)
    raise InputError(f"{path}: ending '{path.suffix}' is unknown; allowed: .gif, .mp4")
