# SPDX-License-Identifier: Apache-2.0
"""Implicit time integration of a structure: generalised-alpha on positions and rotations.

Chung & Hulbert, J. Appl. Mech. 60 (1993) 371, in the Lie-group form of Bruls, Cardona & Arnold, Mech. Mach.
Theory 48 (2012) 121: equilibrium holds at the end of the step, and an auxiliary acceleration a carries the
averaging,

    (1 - am) a1 + am a0 = (1 - af) v1' + af v0',
    dq = h v0 + h^2 ((1/2 - beta) a0 + beta a1),     v1 = v0 + h ((1 - gamma) a0 + gamma a1),

second order, unconditionally stable for linear motion, with the spectral radius at infinity as the one
setting (1: no dissipation). Newton reuses a factorised tangent over many steps: it is kept together with the
orientation of the carrier frames it was built in, and right-hand sides are turned into those frames, so that
the stroke itself does not make it stale.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cwmav_common.errors import WorkError
from cwmav_common.settings import setting
from cwmav_sim.wing.account import account
from cwmav_sim.wing.block_lu import Factors
from cwmav_sim.wing.dynamics import Carrier, Configuration, Driven, Load, System
from cwmav_sim.wing.motion import Counters, Energies, Motion
from cwmav_sim.wing.motion_loops import displaced, further, largest, turned_rows
from cwmav_sim.wing.rotation import logarithm, orthonormal, turn
from cwmav_sim.wing.sheet import FloatArray


@dataclass(frozen=True)
class Integration:
    """Settings of the time integration."""

    spectral_radius: float = setting(
        0.8, "spectral radius of generalised-alpha at infinite frequency (1: no dissipation)", ge=0, le=1
    )
    tolerance: float = setting(1e-6, "residual of Newton over the largest force in play", gt=0, le=1e-2)
    iterations: int = setting(20, "Newton iterations before a step is halved", ge=2, le=100)
    longest_step: float = setting(5e-4, "longest step; a longer interval is divided", unit="s", gt=0)
    halvings: int = setting(12, "how often a step that does not converge may be halved", ge=0, le=30)
    slowest_contraction: float = setting(
        0.3, "residual ratio of two iterations above which the tangent is built anew", gt=0, lt=1
    )


_State = tuple[Configuration, FloatArray, FloatArray]  # with true acceleration and the step's displacement


class _NotConvergedError(Exception):
    """Newton failed within its iterations."""


@dataclass
class _Factor:
    factors: Factors
    axes: FloatArray  # carrier orientation the tangent was built in
    step: float


class Integrator:
    """Steps a :class:`System` through time.

    Parameters
    ----------
    system : System
        The structure.
    settings : Integration
        Method and tolerances.
    x, turn_ : ndarray, shapes (n, 3) and (k, 3, 3)
        Start configuration.
    time : float
        Start time [s]; velocities start as those of the carrier frames.
    v, spin : ndarray, optional
        Start velocities instead.
    """

    def __init__(
        self,
        system: System,
        settings: Integration,
        x: FloatArray,
        turn_: FloatArray,
        *,
        time: float = 0.0,
        v: FloatArray | None = None,
        spin: FloatArray | None = None,
        load: Load | None = None,
    ) -> None:
        self.system, self.settings, self.counters = system, settings, Counters()
        rho = settings.spectral_radius
        self._am, self._af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        self._gamma = 0.5 - self._am + self._af
        self._beta = 0.25 * (1.0 - self._am + self._af) ** 2
        self._factor: _Factor | None = None
        start = Configuration(
            x.copy(),
            np.zeros_like(x) if v is None else v.copy(),
            turn_.copy(),
            np.zeros((len(turn_), 3)) if spin is None else spin.copy(),
        )
        self._floor = system.rounding(start)
        self.motion = self._begin(start, time, load or self._no_load)

    @property
    def share_of_begin(self) -> float:
        """Weight of the begin of a step in the forces that the method averages; the end has the rest."""
        return self._af

    def advance(self, time: float, load: Load | None = None) -> Motion:
        """Go on to ``time`` [s] under ``load`` at that instant.

        Raises
        ------
        WorkError
            Newton does not converge even with the shortest step.
        """
        load = load or self._no_load
        limit = self.settings.longest_step
        count = max(1, int(np.ceil((time - self.motion.time) / limit * (1.0 - 1e-9))))
        start, first = self.motion.time, self.motion.force
        for k in range(1, count + 1):
            share = k / count
            target = time if k == count else start + share * (time - start)
            self._divide(target, _blend(first, load, share), self.settings.halvings)
        return self.motion

    def restore(self, motion: Motion) -> None:
        """Continue from a stored instant; every continuation from it repeats bit for bit."""
        self.motion, self._factor = motion, None

    def amend(self, motion: Motion) -> None:
        """Replace the newest instant, as contacts do, without forgetting the factorised tangent."""
        self.motion = motion

    def _no_load(self, c: Configuration) -> FloatArray:
        return np.zeros((self.system.rows, 3))

    def _begin(self, c: Configuration, time: float, load: Load) -> Motion:
        s = self.system
        driven = s.drive.at(time)
        c = self._hold(c, driven)
        carrier = s.drive.carrier(time)
        force = load(c)
        zero = np.zeros((s.rows, 3))
        unbalanced = force - s.internal(c) - s.drag(c, carrier) - s.inertial(c, zero)
        acceleration = s.solve_inertia(c, unbalanced)
        self._hold_acceleration(acceleration, driven)
        reaction = (s.inertial(c, acceleration) + s.internal(c) + s.drag(c, carrier) - force)[s.held_rows]
        stored = s.kinetic(c), s.elastic(c)
        energies = Energies(stored[0], stored[1], 0.0, 0.0, 0.0, 0.0, sum(stored))
        return Motion(time, c, acceleration, acceleration.copy(), force, reaction, energies)

    def _divide(self, target: float, load: Load, halvings: int) -> None:
        """One step to ``target``, halved until it converges."""
        try:
            with np.errstate(all="ignore"):  # an iterate that runs away is found by its residual
                self.motion = self._step(target, load)
        except _NotConvergedError:
            if halvings == 0:
                raise WorkError(
                    f"wing structure: no equilibrium at t = {target:.6g} s even with a step of "
                    f"{target - self.motion.time:.2g} s; lower the load or raise integration.iterations"
                ) from None
            self.counters.halvings += 1
            begin = self.motion
            middle = 0.5 * (begin.time + target)
            self._divide(middle, _blend(begin.force, load, 0.5), halvings - 1)
            self._divide(target, load, halvings - 1)

    def _step(self, target: float, load: Load) -> Motion:
        s, old = self.system, self.motion
        h = target - old.time
        driven, carrier = s.drive.at(target), s.drive.carrier(target)
        state = self._hold_state(self._predicted(old, carrier, h), driven)
        ratio = (1.0 - self._am) / (h * h * self._beta * (1.0 - self._af))
        rate = self._gamma / (h * self._beta)
        before, fresh = np.inf, False
        for iteration in range(self.settings.iterations + 1):
            c, acceleration, _ = state
            force = load(c)
            internal, inertial = s.internal(c), s.inertial(c, acceleration)
            residual = inertial + internal + s.drag(c, carrier) - force
            free = residual[s.free_rows]
            size = largest(free)
            scale = max(largest(f) for f in (internal, inertial, force))
            if not np.isfinite(size):
                raise _NotConvergedError
            if size <= max(self.settings.tolerance * scale, self._floor):
                return self._finish(target, state, force, residual[s.held_rows], driven, carrier)
            if iteration == self.settings.iterations:
                raise _NotConvergedError
            if self._stale(h) or (size > self.settings.slowest_contraction * before and not fresh):
                self._factorise(c, carrier, h, rate, ratio)
                fresh = True
            else:
                fresh = False
            before = size
            self.counters.iterations += 1
            change = -self._solve(free, carrier)
            state = self._corrected(old, state, change, rate, ratio, driven)
        raise _NotConvergedError

    def _predicted(self, old: Motion, carrier: Carrier, h: float) -> _State:
        """Guess the new state: everything travels rigidly with its carrier frame.

        A guess from the old accelerations would be nearer for smooth motion, but it strains stiff rods and
        film by their smallest vibration; this one leaves all strains as they are, and the first Newton step
        is then the exact linear response.
        """
        before = self.system.drive.carrier(old.time).axes
        swing = (carrier.axes @ np.swapaxes(before, 1, 2))[self.system.drive.group]
        n, c = self.system.nodes, old.configuration
        moved = np.concatenate([turn(swing[:n], c.x) - c.x, logarithm(swing[n:])])
        auxiliary = ((moved - h * c.rates) / (h * h) - (0.5 - self._beta) * old.auxiliary) / self._beta
        velocity = c.rates + h * ((1.0 - self._gamma) * old.auxiliary + self._gamma * auxiliary)
        acceleration = (1.0 - self._am) * auxiliary + self._am * old.auxiliary - self._af * old.acceleration
        return self._moved(c, moved, velocity), acceleration / (1.0 - self._af), moved

    def _moved(self, c: Configuration, moved: FloatArray, velocity: FloatArray) -> Configuration:
        n = self.system.nodes
        x, turned = displaced(c.x, c.turn, moved)
        return Configuration(x, velocity[:n], turned, velocity[n:])

    def _corrected(
        self,
        old: Motion,
        state: _State,
        change: FloatArray,
        rate: float,
        ratio: float,
        driven: Driven,
    ) -> _State:
        c, acceleration, moved = state
        step = further(moved, change, self.system.free_rows, self.system.nodes)
        moved = moved + step
        velocity = c.rates + rate * step
        acceleration = acceleration + ratio * step
        return self._hold_state(
            (self._moved(old.configuration, moved, velocity), acceleration, moved), driven
        )

    def _hold_state(self, state: _State, driven: Driven) -> _State:
        c, acceleration, moved = state
        self._hold_acceleration(acceleration, driven)
        return self._hold(c, driven), acceleration, moved

    def _hold(self, c: Configuration, driven: Driven) -> Configuration:
        nodes, bodies = self.system.drive.nodes, self.system.drive.bodies
        c.x[nodes], c.v[nodes] = driven.x, driven.v
        c.turn[bodies], c.spin[bodies] = driven.turn, driven.spin
        return c

    def _hold_acceleration(self, acceleration: FloatArray, driven: Driven) -> None:
        drive = self.system.drive
        acceleration[drive.nodes] = driven.a
        acceleration[self.system.nodes + drive.bodies] = driven.spin_rate

    def _stale(self, h: float) -> bool:
        return self._factor is None or not 0.8 < h / self._factor.step < 1.25

    def _factorise(self, c: Configuration, carrier: Carrier, h: float, rate: float, ratio: float) -> None:
        matrix = self.system.matrix(c, rate=rate, mass_factor=ratio, stressed=self.motion.configuration)
        try:
            self._factor = _Factor(self.system.factorised(matrix), carrier.axes, h)
        except RuntimeError:
            raise _NotConvergedError from None
        self.counters.factorisations += 1

    def _solve(self, free: FloatArray, carrier: Carrier) -> FloatArray:
        factor, rows, group = self._factor, self.system.free_rows, self.system.drive.group
        assert factor is not None  # noqa: S101 - set by _factorise before every first use
        relative = carrier.axes @ np.swapaxes(factor.axes, 1, 2)
        back = np.ascontiguousarray(np.swapaxes(relative, 1, 2))
        return turned_rows(relative, group, rows, factor.factors.solve(turned_rows(back, group, rows, free)))

    def _finish(
        self,
        target: float,
        state: _State,
        force: FloatArray,
        reaction: FloatArray,
        driven: Driven,
        carrier: Carrier,
    ) -> Motion:
        c, acceleration, moved = state
        c = replace(c, turn=orthonormal(c.turn))
        old = self.motion
        auxiliary = (
            (1.0 - self._af) * acceleration + self._af * old.acceleration - self._am * old.auxiliary
        ) / (1.0 - self._am)
        self._hold_acceleration(auxiliary, driven)
        self.counters.steps += 1
        energies = account(self.system, old, target, c, moved, force, reaction)
        return Motion(target, c, acceleration, auxiliary, force, reaction, energies)


def _blend(first: FloatArray, load: Load, share: float) -> Load:
    """Load at a share of the way from ``first`` to ``load``."""
    if share >= 1.0:
        return load

    def between(c: Configuration) -> FloatArray:
        return (1.0 - share) * first + share * load(c)

    return between
