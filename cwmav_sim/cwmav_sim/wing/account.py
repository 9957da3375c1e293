# SPDX-License-Identifier: Apache-2.0
"""Energy account of one step of a structure."""

from __future__ import annotations

from cwmav_sim.wing.dynamics import System
from cwmav_sim.wing.motion import Energies, Motion
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.sheet import FloatArray, IntArray
from cwmav_sim.wing.step_loops import doubled_works, half_way, travelled


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
    h, begin, arithmetic = target - old.time, old.configuration, system.arithmetic
    driven = system.places.driven
    way = arithmetic.empty(system.rows, 3)
    arithmetic.run(travelled, system.rows, h, driven, begin, c, moved, way)
    middle = system.room()
    arithmetic.run(half_way, system.rows, h, driven, begin, c, moved, middle)
    lost, carried = system.drag_power(middle, system.drive.carrier(0.5 * (old.time + target)))
    e = old.energies
    return Energies(
        kinetic=system.kinetic(c),
        elastic=system.elastic(c),
        dissipated=e.dissipated + h * (lost + system.viscous_power(middle)),
        contact=e.contact,
        load_work=e.load_work + _work(system, system.places.every, old.force, force, way),
        drive_work=e.drive_work
        + _work(system, system.places.held, old.reaction, reaction, way)
        - h * carried,
        initial=e.initial,
    )


def _work(system: System, rows: IntArray, one: FloatArray, other: FloatArray, way: FloatArray) -> float:
    """Work of the mean of two forces on the way of their rows [J]."""
    out = system.arithmetic.empty(len(rows))
    system.arithmetic.run(doubled_works, len(rows), rows, one, other, way, out)
    return 0.5 * system.arithmetic.total(out)
