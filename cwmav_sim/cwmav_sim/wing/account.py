# SPDX-License-Identifier: Apache-2.0
"""Energy account of one step of a structure."""

from __future__ import annotations

import numpy as np

from cwmav_sim.wing.dynamics import Configuration, System
from cwmav_sim.wing.motion import Energies, Motion
from cwmav_sim.wing.motion_loops import displaced
from cwmav_sim.wing.rotation import logarithm
from cwmav_sim.wing.sheet import FloatArray


def account(
    system: System,
    old: Motion,
    target: float,
    c: Configuration,
    moved: FloatArray,
    force: FloatArray,
    reaction: FloatArray,
) -> Energies:
    """Add the work of one step: loads and reactions by the trapezoidal rule, losses at its middle.

    Parameters
    ----------
    system, old : System, Motion
        The structure and the begin of the step.
    target : float
        Time at its end [s].
    c : Configuration
        Where everything is then.
    moved : ndarray, shape (n + k, 3)
        Displacements [m] and rotation vectors of the free rows.
    force, reaction : ndarray, shapes (n + k, 3) and (h, 3)
        External forces and moments, and those that hold the driven rows, at the end.
    """
    h, drive, held = target - old.time, system.drive, system.held_rows
    travelled = 0.5 * h * (old.configuration.rates + c.rates)
    travelled[system.free_rows] = moved[system.free_rows]
    travelled[drive.nodes] = c.x[drive.nodes] - old.configuration.x[drive.nodes]
    load_work = 0.5 * float(np.sum((old.force + force) * travelled))
    drive_work = 0.5 * float(np.sum((old.reaction + reaction) * travelled[held]))
    middle, between = _middle(system, old.configuration, c, moved, h), 0.5 * (old.time + target)
    lost, carried = system.drag_power(middle, drive.carrier(between))
    e = old.energies
    return Energies(
        kinetic=system.kinetic(c),
        elastic=system.elastic(c),
        dissipated=e.dissipated + h * (lost + system.viscous_power(middle)),
        contact=e.contact,
        load_work=e.load_work + load_work,
        drive_work=e.drive_work + drive_work - h * carried,
        initial=e.initial,
    )


def _middle(
    system: System, old: Configuration, c: Configuration, moved: FloatArray, h: float
) -> Configuration:
    """Half-way configuration with the step's mean velocities: its strain rates are the exact changes."""
    n, nodes, bodies = system.nodes, system.drive.nodes, system.drive.bodies
    moved = moved.copy()
    moved[nodes] = c.x[nodes] - old.x[nodes]
    moved[n + bodies] = logarithm(c.turn[bodies] @ np.swapaxes(old.turn[bodies], 1, 2))
    x, half = displaced(old.x, old.turn, 0.5 * moved)
    return Configuration(x, moved[:n] / h, half, moved[n:] / h)
