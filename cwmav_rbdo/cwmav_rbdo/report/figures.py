# SPDX-License-Identifier: Apache-2.0
"""Figures of the report as SVG: the surfaces of the paper's Fig. 10, convergence, reliability."""

from __future__ import annotations

import io
from collections.abc import Iterator
from itertools import combinations

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from cwmav_rbdo.lift_to_power import RatioSurrogate
from cwmav_rbdo.loop import AcceleratedLoop

Array = NDArray[np.float64]
_GRID = 81
_LABELS = {"F": "flapping frequency F", "AoA": "angle of attack AoA", "U": "forward velocity U"}


def svg(figure: Figure) -> str:
    """Render a figure as an ``<svg>`` element; equal figures give equal text."""
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "cwmav", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None}, bbox_inches="tight")
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def surfaces(loop: AcceleratedLoop) -> Iterator[tuple[str, str]]:
    """Predicted L/P and its Kriging error over each pair of variables through the optimum: caption, SVG."""
    if loop.surface is None or not loop.iterations:
        return
    names = loop.problem.names
    if len(names) == 1:
        yield "Predicted L/P with its 95 % band, and the samples", svg(_line(loop, loop.surface))
        return
    for i, j in combinations(range(len(names)), 2):
        others = [k for k in range(len(names)) if k not in (i, j)]
        at = "".join(
            f"; {names[k]} at {loop.iterations[-1].x[k]:.4g} {loop.problem.units[k]}" for k in others
        )
        caption = f"Response (left) and Kriging mean square error (right) over {names[i]} and {names[j]}{at}"
        yield caption, svg(_pair(loop, loop.surface, i, j))


def convergence(loop: AcceleratedLoop) -> str:
    """Prediction against response, error against c1, Kriging error, over the iterations."""
    rows = loop.iterations
    n = np.array([row.iteration for row in rows])
    figure = Figure(figsize=(11.0, 3.2), layout="constrained")
    ratio, error, mse = figure.subplots(1, 3)
    ratio.errorbar(
        n,
        [r.prediction for r in rows],
        [r.prediction_std for r in rows],
        fmt="o-",
        capsize=3,
        label="predicted",
    )
    ratio.errorbar(
        n, [r.response for r in rows], [r.response_std for r in rows], fmt="s", capsize=3, label="evaluated"
    )
    if loop.problem.require.lift_to_power is not None:
        ratio.axhline(loop.problem.require.lift_to_power, color="0.5", ls=":", label="required")
    ratio.set_ylabel("L/P at the optimum [N/W]")
    ratio.legend()
    error.plot(n, [100.0 * r.error for r in rows], "o-")
    error.axhline(100.0 * loop.problem.criteria.c1, color="0.5", ls=":", label="c1")
    error.set_ylabel("error at the optimum, Eq. 12 [%]")
    error.set_yscale("log")
    error.legend()
    mse.semilogy(n, [r.max_mse for r in rows], "^-", label="largest in the space")
    mse.semilogy(n, [r.mse for r in rows], "o-", label="at the optimum")
    mse.set_ylabel("Kriging MSE, Eq. 20 [(N/W)²]")
    mse.legend()
    for axes in (ratio, error, mse):
        axes.set_xlabel("iteration")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return svg(figure)


def reliability(loop: AcceleratedLoop) -> str:
    """Reliability of the optimum with the band that the surrogate's error leaves."""
    rows = loop.iterations
    n = [row.iteration for row in rows]
    figure = Figure(figsize=(5.5, 3.2), layout="constrained")
    axes = figure.subplots()
    low, high = [r.reliability.low for r in rows], [r.reliability.high for r in rows]
    axes.fill_between(n, low, high, alpha=0.25, label="left open by the surrogate's error")
    axes.plot(n, [r.reliability.value for r in rows], "o-", label="of the mean surface")
    axes.axhline(loop.problem.require.reliability, color="0.5", ls=":", label="required")
    axes.set_xlabel("iteration")
    axes.set_ylabel("reliability [1]")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend()
    return svg(figure)


def _pair(loop: AcceleratedLoop, surface: RatioSurrogate, i: int, j: int) -> Figure:
    problem = loop.problem
    u = np.linspace(problem.lower[i], problem.upper[i], _GRID)
    v = np.linspace(problem.lower[j], problem.upper[j], _GRID)
    X = np.tile(loop.iterations[-1].x, (_GRID * _GRID, 1))
    X[:, i], X[:, j] = (m.ravel() for m in np.meshgrid(u, v))
    mean, std = (values.reshape(_GRID, _GRID) for values in surface.predict(X))
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    axes = figure.subplots(1, 2)
    # A surrogate far from its samples can be wild: levels of the samples keep the rest readable.
    ratios = np.array([e.lift_to_power for e in loop.samples.evaluations])
    levels = np.linspace(ratios.min(), max(ratios.max(), loop.iterations[-1].prediction), 15)
    filled = axes[0].contourf(u, v, mean, levels=levels, extend="both", cmap="viridis")
    figure.colorbar(filled, ax=axes[0], label="predicted L/P [N/W]")
    filled = axes[1].contourf(u, v, np.log10(np.maximum(std**2, 1e-12)), levels=15, cmap="magma")
    figure.colorbar(filled, ax=axes[1], label="log10 of the Kriging MSE [(N/W)²]")
    required = problem.require.lift_to_power
    if required is not None and mean.min() < required < mean.max():
        axes[0].contour(u, v, mean, levels=[required], colors="w", linestyles="--")
    for a in axes:
        _mark(a, loop, i, j)
    return figure


def _mark(axes: Axes, loop: AcceleratedLoop, i: int, j: int) -> None:
    problem, row, X = loop.problem, loop.iterations[-1], loop.samples.X
    initial = problem.initial_samples
    axes.plot(X[:initial, i], X[:initial, j], "o", mfc="none", mec="w", label="initial samples")
    axes.plot(X[initial:, i], X[initial:, j], "o", color="w", ms=4, label="added samples")
    axes.plot(row.x[i], row.x[j], "r*", ms=12, label="optimum")
    size = row.window_upper - row.window_lower
    axes.add_patch(
        Rectangle((row.window_lower[i], row.window_lower[j]), size[i], size[j], fill=False, ec="w", lw=1.5)
    )
    axes.set_xlabel(_axis(loop, i))
    axes.set_ylabel(_axis(loop, j))
    axes.legend(fontsize="x-small", facecolor="0.3", labelcolor="w", loc="upper right")


def _line(loop: AcceleratedLoop, surface: RatioSurrogate) -> Figure:
    problem = loop.problem
    x = np.linspace(problem.lower[0], problem.upper[0], 4 * _GRID)
    mean, std = surface.predict(x[:, None])
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.fill_between(x, mean - 1.96 * std, mean + 1.96 * std, alpha=0.25)
    axes.plot(x, mean)
    ratios = [e.lift_to_power for e in loop.samples.evaluations]
    axes.plot(loop.samples.X[:, 0], ratios, "ko", label="samples")
    axes.axvline(loop.iterations[-1].x[0], color="r", label="optimum")
    axes.set_xlabel(_axis(loop, 0))
    axes.set_ylabel("predicted L/P [N/W]")
    axes.legend()
    return figure


def _axis(loop: AcceleratedLoop, k: int) -> str:
    name = loop.problem.names[k]
    return f"{_LABELS[name]} [{loop.problem.units[k]}]"
