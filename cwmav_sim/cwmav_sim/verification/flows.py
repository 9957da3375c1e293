# SPDX-License-Identifier: Apache-2.0
"""What plane cases share: settings in units of the case, forces and balance, velocities at places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from cwmav_sim.solver import Solver, StepInfo
from cwmav_sim.sph.kernel import Kernel
from cwmav_sim.sph.settings import Box, FlowSettings, Fluid, Fringe, Resolution, SheetOptions, Shifting
from cwmav_sim.verification.protocol import Check
from cwmav_sim.wing.sheet import FloatArray

NO_FRINGE = Fringe(width=0.0)
OUTSIDE = 4  # spacings of empty room beyond the walls of a channel, so that opposite sides never meet


def plane_flow(
    dp: float,
    length: float,
    height: float,
    *,
    viscosity: float,
    sound_speed: float,
    upstream: float = 0.0,
    gravity: float = 0.0,
    background_pressure: float = 0.0,
    fringe: Fringe = NO_FRINGE,
    set_back: float = 0.25,
    precision: str = "double",
    cfl: float = 0.4,
    jitter: float = 0.1,
) -> FlowSettings:
    """Return settings of a plane flow of density 1 in the units of the case."""
    return FlowSettings(
        fluid=Fluid(
            density=1.0,
            viscosity=viscosity,
            sound_speed=sound_speed,
            mach_limit=0.5,
            gravity=gravity,
            background_pressure=background_pressure,
        ),
        resolution=Resolution(dp=dp, cfl=cfl, precision=precision, jitter=jitter),
        box=Box(length=length, width=1.0, height=height, upstream=upstream, symmetric=False, dimensions=2),
        fringe=fringe,
        shifting=Shifting(),
        sheet=SheetOptions(set_back=set_back),
    )


@dataclass
class History:
    """Forces on chosen panels against time, and what the balance of momentum needs.

    Attributes
    ----------
    time : list of float
        End of every step [s].
    force : list of ndarray, shape (panels, 3)
        Mean force of the air on every panel over the step [N per m].
    """

    solver: Solver
    time: list[float] = field(default_factory=list)
    force: list[FloatArray] = field(default_factory=list)
    _start: FloatArray = field(init=False)
    _size: float = 0.0

    def __post_init__(self) -> None:
        self._start = self.solver.momentum()

    def until(self, end: float, each: Callable[[StepInfo], None] | None = None) -> None:
        """Step the solver to time ``end`` [s]."""
        while self.solver.time < end:
            info = self.solver.step()
            force = info.pressure + info.viscous
            self.time.append(info.time)
            self.force.append(force)
            self._size += info.dt * float(np.linalg.norm(force, axis=1).sum())
            if each is not None:
                each(info)

    def forces(self, panel: int | None = None) -> tuple[FloatArray, FloatArray]:
        """Return times at the middle of the steps, shape (n,), and forces along x and z, shape (n, 2).

        Summed over all panels unless one is named.
        """
        time = np.array(self.time)
        middle = 0.5 * (time + np.concatenate([[0.0], time[:-1]]))
        force = np.array(self.force)
        total = force.sum(axis=1) if panel is None else force[:, panel]
        return middle, total[:, [0, 2]]

    def balance(self, name: str, tolerance_percent: float = 1e-4) -> Check:
        """Momentum of the air against every impulse, over the impulse on the walls summed by size."""
        solver = self.solver
        given = solver.fringe_impulse + solver.gravity_impulse - solver.wall_impulse
        missing = float(np.linalg.norm((solver.momentum() - self._start - given)[[0, 2]]))
        return Check(
            name,
            "momentum not accounted for [N s/m]",
            missing,
            0.0,
            max(self._size, 1e-300),
            tolerance_percent,
            "exact: Newton's third law",
        )


class HeldVolume:
    """Keeps the volume of all air of a solver in a closed vessel, after each step.

    Continuity moves it slowly where motion and arrangement of the particles correlate; nothing lets the
    pressure out again, and a high mean pressure shakes the particles. All densities are multiplied alike.
    """

    def __init__(self, solver: Solver) -> None:
        self._solver = solver
        self._volume = float(np.sum(1.0 / solver.density))

    def __call__(self, info: StepInfo) -> None:
        """Bring the volume back after a step."""
        density = self._solver.density
        density *= float(np.sum(1.0 / density)) / self._volume


def at_places(solver: Solver, places: FloatArray, h: float) -> FloatArray:
    """Return the velocity along x and z at places in the plane, first-order consistent.

    Parameters
    ----------
    solver : Solver
        Two-dimensional.
    places : ndarray, shape (m, 2)
        x and z [m].
    h : float
        Smoothing length [m].
    """
    kernel = Kernel(h, 2)
    points = solver.position[:, [0, 2]]
    tree = cKDTree(points)
    out = np.empty((len(places), 2))
    for k, near in enumerate(tree.query_ball_point(places, 2.0 * h)):
        offset = points[near] - places[k]
        w = np.sqrt(kernel.value(np.linalg.norm(offset, axis=1)))[:, None]
        basis = np.column_stack([np.ones(len(offset)), offset])
        values = solver.velocity[near][:, [0, 2]]
        out[k] = np.linalg.lstsq(w * basis, w * values, rcond=None)[0][0]
    return out


def smoothed(time: FloatArray, values: FloatArray, at: FloatArray, half_width: float) -> FloatArray:
    """Return means of ``values``, shape (n,), over windows of time around ``at``."""
    return np.array([values[np.abs(time - t) <= half_width].mean() for t in at])
