# SPDX-License-Identifier: Apache-2.0
"""What a run keeps account of: inertia of the wings, mass, momentum and energy, and what it cost."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_sim.case import Case
from cwmav_sim.coupling import CoupledWings
from cwmav_sim.devices import AirSolver
from cwmav_sim.gauges import History, cycle_mean, phase_bins
from cwmav_sim.sph.sheet import Nodes
from cwmav_sim.wing.sheet import FloatArray, SheetMotion, triangle_areas


class WingInertia:
    """Force of inertia of every panel: minus the rate of change of its momentum over each step.

    Parameters
    ----------
    case : Case
        Gives the mass of film and rods.
    motion : SheetMotion
        The wings at the start of the run.
    """

    def __init__(self, case: Case, motion: SheetMotion) -> None:
        count = len(motion.panel_names)
        mass = case.nodal_mass()
        of_node = np.zeros(len(mass), np.int64)
        of_node[motion.triangles] = motion.panel[:, None]
        self._share = np.zeros((count, len(mass)))
        self._share[of_node, np.arange(len(mass))] = mass
        self._momentum = self._share @ motion.state(0.0).v

    def force(self, nodes: Nodes | None, dt: float) -> FloatArray:
        """Return the force [N], shape (panels, 3), of a step of ``dt`` [s] that led to ``nodes``."""
        before = self._momentum
        if nodes is not None:
            self._momentum = self._share @ nodes.v
        return np.asarray((before - self._momentum) / dt)

    def save(self) -> dict[str, NDArray]:
        """Return the momentum."""
        return {"momentum": self._momentum}

    def restore(self, saved: dict[str, NDArray]) -> None:
        """Go on from a momentum."""
        self._momentum = saved["momentum"]


@dataclass
class Ledger:
    """Momentum and kinetic energy of the air at the start, and the work of the wings on it."""

    momentum: FloatArray
    kinetic: float
    particles: int
    work: float = 0.0

    @classmethod
    def of(cls, solver: AirSolver) -> Ledger:
        """Open the account of a run at its start."""
        return cls(solver.momentum(), solver.kinetic_energy(), solver.particles)

    def add(self, dt: float, power: FloatArray) -> None:
        """Add the work of a step."""
        self.work += dt * float(np.sum(power))

    def save(self) -> dict[str, NDArray]:
        """Return the work."""
        return {"work": np.array(self.work)}

    def restore(self, saved: dict[str, NDArray]) -> None:
        """Go on from a work."""
        self.work = float(saved["work"])

    def balance(self, solver: AirSolver, motion: SheetMotion, case: Case) -> dict[str, Any]:
        """Close the account; the figures are those of the simulated part of the box, half in a half model.

        Returns
        -------
        dict
            Particles lost, put back at walls and let through by them (two-sided walls put back, plain ones
            let through), leak flux [m/s] (volume of either, per area and time), residual of the momentum
            balance over the largest impulse, energies of the air [J], and for flexible wings their energy
            account with what the exchange with the air lost.
        """
        impulse = solver.fringe_impulse + solver.gravity_impulse - solver.wall_impulse
        residual = solver.momentum() - self.momentum - impulse
        if case.flow.box.symmetric:
            residual[1] = 0.0  # the mirror takes sideways momentum
        largest = max(float(np.abs(p).max()) for p in (solver.wall_impulse, solver.fringe_impulse))
        area = float(triangle_areas(motion.state(solver.time).x, motion.triangles).sum())
        volume = solver.crossings * case.flow.resolution.dp**3
        change = solver.kinetic_energy() - self.kinetic
        plain = case.flow.sheet.treatment == "dbc"
        out: dict[str, Any] = {
            "particles_lost": self.particles - len(np.unique(solver.identity)),
            "particles_put_back": 0 if plain else solver.crossings,
            "particles_let_through": solver.crossings if plain else 0,
            "leak_flux_m_s": volume / (area * solver.time),
            "momentum_residual": float(np.abs(residual).max()) / largest if largest else 0.0,
            "air_j": {
                "work_of_wings": self.work,
                "work_of_fringe": solver.fringe_work,
                "kinetic_change": change,
                "dissipated_or_compressed": self.work + solver.fringe_work - change,
            },
        }
        if isinstance(motion, CoupledWings):
            energies = motion.energies
            out["wings_j"] = asdict(energies) | {
                "lost_by_integration": energies.numerical,
                "made_by_exchange": energies.load_work + self.work,
            }
        return out


def mean_parts(history: History, frequency: float, discard: int) -> dict[str, Any]:
    """Return cycle means with standard uncertainties of the parts of lift and drag, and of the pitch moment.

    The part of inertia averages to nothing over a periodic cycle; its mean tells how periodic the wings are.
    """

    def mean(signal: FloatArray) -> dict[str, float]:
        found = cycle_mean(phase_bins(history.time, signal, frequency), discard)
        return {"mean": found.mean, "std": found.std}

    out: dict[str, Any] = {}
    for name in ("pressure", "viscous", "inertial"):
        force = history.part(getattr(history, name))
        out[name] = {"lift_n": mean(force[:, 2]), "drag_n": mean(force[:, 0])}
    out["pitch_moment_n_m"] = mean(history.pitch_moment())
    out["power_w"] = mean(history.total_power())
    return out


def cost(solver: AirSolver, steps: int, wall: float, card: str | None = None) -> dict[str, Any]:
    """Return seconds of every phase and the rate of pair interactions, two passes per step.

    The phases are those since the run was last resumed. A run on a graphics card has its name too; there the
    phases are those of the host: starting kernels, waiting for the card, and the structure.
    """
    out: dict[str, Any] = {
        "phases_s": {name: float(s) for name, s in solver.timers.seconds.items()},
        "pair_interactions_per_s": 2.0 * solver.pairs() * steps / wall,
    }
    return out if card is None else out | {"card": card}
