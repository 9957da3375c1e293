# SPDX-License-Identifier: Apache-2.0
"""One picture of a run: lift against time, and the vorticity in a slice through the wings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from cwmav_sim.case import Case
from cwmav_sim.gauges import History, phase_bins
from cwmav_sim.result import LiftResult, describe_point
from cwmav_sim.views import ParticleView
from cwmav_sim.wing.sheet import FloatArray, SheetMotion

_SPAN_SHARE = 0.6  # the slice cuts the wings at this share of their length


class FlowView(Protocol):
    """What a slice reads: an instant [s], positions [m] and velocities [m/s] of particles (n, 3)."""

    @property
    def time(self) -> float:
        """Instant [s]."""
        ...

    @property
    def position(self) -> FloatArray:
        """Positions [m], shape (n, 3)."""
        ...

    @property
    def velocity(self) -> FloatArray:
        """Velocities [m/s], shape (n, 3)."""
        ...


@dataclass(frozen=True)
class FlowSlice:
    """Velocity around the wings in a plane of constant y.

    Attributes
    ----------
    x, z : ndarray, shape (nx,), (nz,)
        Grid lines [m].
    vorticity : ndarray, shape (nz, nx)
        Component along y, du/dz - dw/dx [1/s].
    wings : tuple of ndarray, shape (k, 2, 2)
        Lines where the wings cut the plane: pairs of (x, z) [m].
    time, y : float
        Instant [s] and place [m] of the slice.
    """

    x: FloatArray
    z: FloatArray
    vorticity: FloatArray
    wings: FloatArray
    time: float
    y: float


class SliceObserver:
    """Keeps a slice of the flow at one phase of the last planned cycle.

    Parameters
    ----------
    case : Case
        The run.
    phase : float
        Share of the cycle, 0 at the clap.
    """

    def __init__(self, case: Case, phase: float = 0.25) -> None:
        self._case = case
        self._motion = case.motion()
        self._due = (case.run.cycles - 1 + phase) / case.flapping_frequency
        self.slice: FlowSlice | None = None

    def __call__(self, view: ParticleView) -> None:
        """Take the slice at the first step after the phase asked for."""
        if self.slice is None and view.time >= self._due:
            self.slice = take_slice(self._case, wing_corners(self._motion, view), view)


class FilmObserver:
    """Keeps slices of the flow at equal phases of the last planned cycle, for an animation.

    Parameters
    ----------
    case : Case
        The run.
    frames : int
        Slices in the cycle.
    """

    def __init__(self, case: Case, frames: int = 48) -> None:
        self._case, self._motion = case, case.motion()
        self._begin, self._interval = (
            (case.run.cycles - 1) / case.flapping_frequency,
            1.0 / (frames * case.flapping_frequency),
        )
        self.slices: list[FlowSlice] = []

    def __call__(self, view: ParticleView) -> None:
        """Take a slice when the next one is due."""
        due = self._begin + len(self.slices) * self._interval
        if view.time >= due and view.time < self._begin + 1.0 / self._case.flapping_frequency:
            self.slices.append(take_slice(self._case, wing_corners(self._motion, view), view))


def wing_corners(motion: SheetMotion, view: ParticleView) -> FloatArray:
    """Return the corners of the wings' triangles at the instant of a view, shape (m, 3, 3)."""
    nodes = view.sheet
    return np.zeros((0, 3, 3)) if nodes is None else nodes.x[motion.triangles]


def take_slice(case: Case, corners: FloatArray, view: FlowView) -> FlowSlice:
    """Interpolate the velocity to a plane through the wings (m, 3, 3) and differentiate it there.

    The interpolation is Shepard-normalised with a quartic weight of two spacings' radius; it smooths the
    jump across a wing over that length.
    """
    box, dp = case.flow.box, case.flow.resolution.dp
    y = _SPAN_SHARE * case.wing.length * np.cos(case.kinematics.dihedral)
    x = np.arange(-box.upstream + dp, box.length - box.upstream - dp, 0.4 * dp)
    z = np.arange(-0.5 * box.height + dp, 0.5 * box.height - dp, 0.4 * dp)
    grid = np.stack(np.meshgrid(x, [y], z, indexing="ij"), axis=-1).reshape(-1, 3)
    velocity = _interpolate(grid, view, 2.5 * dp).reshape(len(x), len(z), 3)
    shear = np.gradient(velocity[:, :, 0], z, axis=1) - np.gradient(velocity[:, :, 2], x, axis=0)
    return FlowSlice(x, z, shear.T, wing_cut(corners, float(y)), view.time, float(y))


def _interpolate(points: FloatArray, view: FlowView, radius: float) -> FloatArray:
    position = np.asarray(view.position, dtype=np.float64)
    velocity = np.asarray(view.velocity, dtype=np.float64)
    distance, index = cKDTree(position).query(points, k=32, distance_upper_bound=radius)
    weight = np.where(np.isfinite(distance), (1.0 - np.minimum(distance / radius, 1.0)) ** 4, 0.0)
    value = velocity[np.minimum(index, len(position) - 1)]
    total = np.maximum(weight.sum(axis=1), 1e-12)
    mean: FloatArray = (weight[:, :, None] * value).sum(axis=1) / total[:, None]
    return mean


def wing_cut(corners: FloatArray, y: float) -> FloatArray:
    """Return the lines where triangles (m, 3, 3) cut a plane of constant y, shape (k, 2, 2) as (x, z) [m]."""
    lines = []
    for triangle in corners:
        ends = []
        for a, b in ((0, 1), (1, 2), (2, 0)):
            first, second = triangle[a], triangle[b]
            if (first[1] - y) * (second[1] - y) < 0:
                share = (y - first[1]) / (second[1] - first[1])
                ends.append((first + share * (second - first))[[0, 2]])
        if len(ends) == 2:
            lines.append(ends)
    return np.array(lines).reshape(-1, 2, 2)


def draw(case: Case, result: LiftResult, flow: FlowSlice, path: str | Path) -> None:
    """Draw lift against time and the vorticity slice, and save the picture.

    Parameters
    ----------
    case, result : Case, LiftResult
        The run; the result needs its history.
    flow : FlowSlice
        From a :class:`SliceObserver`.
    path : path
        Image file; the format follows from its ending.
    """
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    if result.history is not None:
        _draw_lift(left, case, result, result.history)
    draw_slice(right, case, flow)
    figure.suptitle(f"{describe_point(case)}   ({case.preset}, {1e3 * result.dp:g} mm)")
    figure.savefig(path, dpi=130)


def _draw_lift(axes: Axes, case: Case, result: LiftResult, history: History) -> None:
    cycles = history.time * case.flapping_frequency
    binned = phase_bins(history.time, history.lift(), case.flapping_frequency)
    centres = (np.arange(binned.size) + 0.5) / binned.shape[1]
    axes.plot(cycles, history.lift(), color="0.75", linewidth=0.6, label="every step")
    axes.plot(centres, binned.ravel(), color="C0", linewidth=1.4, label="1/64 cycle means")
    axes.axhline(result.mean_lift, color="C3", linewidth=1.2, label=_mean_label(result))
    axes.axvspan(case.run.discard, result.cycles, color="C3", alpha=0.06)
    spread = np.percentile(np.abs(history.lift()[cycles > 0.5]), 99.5)
    axes.set(xlabel="time / flapping period", ylabel="lift [N]", ylim=(-1.1 * spread, 1.1 * spread))
    axes.set_title("lift, wind frame")
    axes.legend(loc="lower right", fontsize="small")


def _mean_label(result: LiftResult) -> str:
    return f"mean {result.mean_lift:.3f} ± {result.lift_std:.3f} N"


def draw_slice(axes: Axes, case: Case, flow: FlowSlice, limit: float | None = None) -> None:
    """Draw one slice; colours end at ``limit`` [1/s], by default at the 99th percentile of the slice."""
    limit = limit or float(np.percentile(np.abs(flow.vorticity), 99.0)) or 1.0
    image = axes.pcolormesh(
        flow.x, flow.z, flow.vorticity, cmap="RdBu_r", vmin=-limit, vmax=limit, shading="gouraud"
    )
    for line in flow.wings:
        axes.plot(line[:, 0], line[:, 1], color="k", linewidth=2.0)
    axes.set(xlabel="x, with the stream [m]", ylabel="z, up [m]", aspect="equal")
    phase = (flow.time * case.flapping_frequency) % 1.0
    axes.set_title(f"vorticity at y = {flow.y:.3f} m, phase {phase:.2f} after the clap")
    axes.figure.colorbar(image, ax=axes, label="vorticity along y [1/s]")
