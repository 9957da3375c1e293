# SPDX-License-Identifier: Apache-2.0
"""The end of a step while Newton looks for it; the equations are in :mod:`cwmav_sim.wing.integrate`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cwmav_sim.wing.account import account
from cwmav_sim.wing.arithmetic import brought_tuple
from cwmav_sim.wing.drive import Driven
from cwmav_sim.wing.dynamics import Load, System
from cwmav_sim.wing.motion import Motion
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.sheet import FloatArray, IntArray
from cwmav_sim.wing.step_loops import (
    Averages,
    averaged,
    corrected,
    held,
    held_acceleration,
    predicted,
    straightened_turns,
)


class Forces(NamedTuple):
    """Forces and moments on all rows, shape (n + k, 3) each: inertial, of the elements, external."""

    inertial: FloatArray
    internal: FloatArray
    external: FloatArray


class Trial:
    """A guess of the end of a step that gets better; its arrays change in place.

    It begins with everything travelling rigidly with its carrier frame. A guess from the old accelerations
    would be nearer for smooth motion, but it strains stiff rods and film by their smallest vibration; this
    one leaves all strains as they are, and the first Newton step is then the exact linear response.

    Parameters
    ----------
    system : System
        The structure.
    averages : Averages
        Constants of the method.
    begin : Motion
        The begin of the step.
    target : float
        Time at its end [s].

    Attributes
    ----------
    c : Configuration
        Where everything is and how fast it moves.
    step : float
        Length of the step [s].
    carrier : Carrier
        Carrier frames at its end.
    """

    def __init__(self, system: System, averages: Averages, begin: Motion, target: float) -> None:
        self._system, self._averages, self._begin, self._target = system, averages, begin, target
        self.step = target - begin.time
        self._driven = brought_tuple(system.arithmetic, system.drive.at(target))
        self.carrier = system.drive.carrier(target)
        self.c, arithmetic = system.room(), system.arithmetic
        self._acceleration, self._moved = (arithmetic.empty(system.rows, 3) for _ in range(2))
        before = system.drive.carrier(begin.time).axes
        swing = arithmetic.brought(self.carrier.axes @ np.swapaxes(before, 1, 2))
        arithmetic.run(
            predicted,
            system.rows,
            self.step,
            averages,
            begin.configuration,
            begin.acceleration,
            begin.auxiliary,
            swing,
            system.places.group,
            self.c,
            self._acceleration,
            self._moved,
        )
        hold(system, self.c, self._driven)
        hold_acceleration(system, self._acceleration, self._driven)

    @property
    def rates(self) -> tuple[float, float]:
        """Changes of velocity [1/s] and of true acceleration [1/s2] per displacement."""
        (am, af, beta, gamma), h = self._averages, self.step
        return gamma / (h * beta), (1.0 - am) / (h * h * beta * (1.0 - af))

    def forces(self, load: Load) -> Forces:
        """Return the forces on all rows under a load."""
        external, internal = load(self.c), self._system.internal(self.c)
        return Forces(self._system.inertial(self.c, self._acceleration), internal, external)

    def unbalanced(self, rows: IntArray, forces: Forces) -> FloatArray:
        """Return what is out of balance in some rows, shape (f, 3)."""
        return self._system.unbalanced(rows, self.c, self.carrier, *forces)

    def correct(self, solution: FloatArray) -> None:
        """Take a solution (f, 3) of Newton off the displacements of the free rows."""
        self._system.arithmetic.run(
            corrected,
            len(self._system.free_rows),
            self._system.places.free,
            solution,
            *self.rates,
            self._begin.configuration,
            self.c,
            self._acceleration,
            self._moved,
        )

    def finished(self, forces: Forces, accounted: bool) -> Motion:
        """Return the motion at the end of the step, in balance, with or without an account of its energy."""
        system, begin = self._system, self._begin
        force, reaction = forces.external, self.unbalanced(system.places.held, forces)
        system.arithmetic.run(straightened_turns, system.bodies, self.c.turn)
        auxiliary = system.arithmetic.empty(system.rows, 3)
        system.arithmetic.run(
            averaged,
            system.rows,
            self._averages,
            begin.acceleration,
            begin.auxiliary,
            self._acceleration,
            auxiliary,
        )
        hold_acceleration(system, auxiliary, self._driven)
        energies = begin.energies
        if accounted:
            energies = account(system, begin, self._target, self.c, self._moved, force, reaction)
        return Motion(self._target, self.c, self._acceleration, auxiliary, force, reaction, energies)


def hold(system: System, c: Configuration, driven: Driven) -> None:
    """Put the driven nodes and bodies of a configuration where they are driven to."""
    places = system.places
    system.arithmetic.run(held, len(system.held_rows), places.nodes, places.bodies, driven, c)


def hold_acceleration(system: System, acceleration: FloatArray, driven: Driven) -> None:
    """Give the driven rows of accelerations (n + k, 3) those they are driven with."""
    system.arithmetic.run(held_acceleration, len(system.held_rows), system.places.held, driven, acceleration)
