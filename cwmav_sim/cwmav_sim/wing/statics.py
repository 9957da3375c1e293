# SPDX-License-Identifier: Apache-2.0
"""Static equilibrium and small vibrations of a structure."""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from cwmav_common.errors import WorkError
from cwmav_sim.wing.dynamics import Load, System
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.rotation import compounded, exponential
from cwmav_sim.wing.sheet import FloatArray

_NEWTON_LIMIT = 20
_PATIENCE = 6  # iterations with the stresses of the step's start before those of the iterate are tried
_LARGEST_TURN = 1.0  # rad in one correction; beyond it the linearisation says nothing


def at_rest(x: FloatArray, turn: FloatArray) -> Configuration:
    """Return a configuration without motion."""
    return Configuration(x.copy(), np.zeros_like(x), turn.copy(), np.zeros((len(turn), 3)))


def equilibrium(
    system: System, start: Configuration, load: Load, *, tolerance: float = 1e-6, steps: int = 200
) -> Configuration:
    """Find the equilibrium under ``load`` with the driven rows held where they are.

    Follows the overdamped motion ``M dq/ds = f_external - f_internal`` to its end by implicit Euler, with a
    pseudo-time step that grows as long as Newton converges (pseudo-transient continuation, Kelley & Keyes,
    SIAM J. Numer. Anal. 35 (1998) 508). Slack film has no stiffness of its own out of its plane and thin
    rods couple bending to their huge axial stiffness, so plain Newton would fail from the unloaded shape.

    Parameters
    ----------
    system : System
        The structure.
    start : Configuration
        First guess; velocities are ignored.
    load : Load
        External forces of a configuration; it may follow the surface.
    tolerance : float
        Largest unbalanced force over the largest force in play.
    steps : int
        Limit of pseudo-time steps.

    Raises
    ------
    WorkError
        No equilibrium within the steps.
    """
    c = at_rest(start.x, start.turn)
    shift, floor = _first_shift(system, c), system.rounding(c)
    for _ in range(steps):
        found = _euler_step(system, c, load, shift, (0.1 * tolerance, floor))
        if found is None:
            shift *= 10.0
            continue
        c, iterations = found
        unbalanced, largest = _unbalanced(system, c, load)
        if unbalanced <= max(tolerance * largest, floor):
            return c
        shift *= 0.05 if iterations <= 4 else 0.3
    unbalanced, largest = _unbalanced(system, c, load)
    raise WorkError(
        f"wing structure: no static equilibrium after {steps} steps; unbalanced force {unbalanced:.3g} N, "
        f"allowed: {tolerance * largest:.3g} N"
    )


def frequencies(system: System, c: Configuration, count: int) -> tuple[FloatArray, FloatArray]:
    """Return the lowest natural frequencies about a configuration and their shapes.

    Undamped small vibrations, K u = (2 pi f)^2 M u; for an unloaded structure or one in equilibrium under
    dead loads.

    Returns
    -------
    f : ndarray, shape (count,)
        Frequencies [Hz], ascending; a negative number stands for the growth of an unstable shape.
    shapes : ndarray, shape (count, n + k, 3)
        Shapes of unit generalised mass.
    """
    stiffness = system.matrix(c, rate=0.0, mass_factor=0.0)
    stiffness = 0.5 * (stiffness + stiffness.T)
    mass = (system.matrix(c, rate=0.0, mass_factor=1.0) - system.matrix(c, rate=0.0, mass_factor=0.0)).tocsc()
    mass = 0.5 * (mass + mass.T)
    sigma = -1.0  # just below zero, so that the shifted matrix stays regular with free modes
    values, vectors = sla.eigsh(sp.csc_matrix(stiffness), k=count, M=sp.csc_matrix(mass), sigma=sigma)
    order = np.argsort(values)
    values, vectors = values[order], vectors[:, order]
    shapes = np.zeros((count, system.rows, 3))
    shapes[:, system.free_rows] = vectors.T.reshape(count, -1, 3)
    return np.sign(values) * np.sqrt(np.abs(values)) / (2.0 * math.pi), shapes


def _euler_step(
    system: System, old: Configuration, load: Load, shift: float, accuracy: tuple[float, float]
) -> tuple[Configuration, int] | None:
    """Solve ``F(q) - f + shift M (q - q_old) = 0``; None when Newton does not converge."""
    n, c = system.nodes, old
    tolerance, floor = accuracy
    moved = np.zeros((system.rows, 3))
    for iteration in range(_NEWTON_LIMIT):
        internal, external = system.internal(c), load(c)
        drag = shift * system.inertial(c, moved)
        residual = (internal - external + drag)[system.free_rows]
        scale = max(float(np.max(np.abs(f), initial=0.0)) for f in (internal, external, drag))
        size = float(np.max(np.abs(residual), initial=0.0))
        if not np.isfinite(size):
            return None
        if size <= max(tolerance * scale, floor):
            return c, iteration
        change = np.zeros((system.rows, 3))
        change[system.free_rows] = _newton(system, c, old if iteration < _PATIENCE else c, residual, shift)
        if np.max(np.abs(change[n:]), initial=0.0) > _LARGEST_TURN:
            return None
        moved = np.concatenate([moved[:n] + change[:n], compounded(moved[n:], change[n:])])
        c = at_rest(old.x + moved[:n], exponential(moved[n:]) @ old.turn)
    return None


def _newton(
    system: System, c: Configuration, stressed: Configuration, residual: FloatArray, shift: float
) -> FloatArray:
    matrix = system.matrix(c, rate=0.0, mass_factor=shift, stressed=stressed)
    return -system.factorised(matrix).solve(residual)


def _unbalanced(system: System, c: Configuration, load: Load) -> tuple[float, float]:
    """Largest unbalanced force, and the largest force in play."""
    internal, external = system.internal(c), load(c)
    residual = (internal - external)[system.free_rows]
    largest = max(float(np.max(np.abs(f), initial=0.0)) for f in (internal, external))
    return float(np.max(np.abs(residual), initial=0.0)), largest


def _first_shift(system: System, c: Configuration) -> float:
    """Shift that makes mass and the typical stiffness comparable."""
    diagonal = np.abs(system.matrix(c, rate=0.0, mass_factor=0.0).diagonal())
    typical = float(np.median(diagonal[diagonal > 0])) if np.any(diagonal > 0) else 1.0
    return 1e-3 * typical / float(np.median(system.inertia.mass))
