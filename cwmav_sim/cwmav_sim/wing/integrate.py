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

from dataclasses import dataclass

import numpy as np

from cwmav_common.errors import WorkError
from cwmav_common.settings import setting
from cwmav_sim.wing.carried_factors import CarriedFactors
from cwmav_sim.wing.dynamics import Load, System
from cwmav_sim.wing.load_loops import between
from cwmav_sim.wing.motion import Counters, Energies, Motion
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.sheet import FloatArray
from cwmav_sim.wing.step_loops import Averages
from cwmav_sim.wing.trial import Trial, hold, hold_acceleration


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


class _NotConvergedError(Exception):
    """Newton failed within its iterations."""


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
        am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        self._averages = Averages(am, af, 0.25 * (1.0 - am + af) ** 2, 0.5 - am + af)
        self._factor: CarriedFactors | None = None
        start = Configuration(
            x.copy(),
            np.zeros_like(x) if v is None else v.copy(),
            turn_.copy(),
            np.zeros((len(turn_), 3)) if spin is None else spin.copy(),
        )
        self._floor = system.rounding(start)
        self.motion = self._begin(start, time, load or self._no_load)

    def bring(self, system: System) -> None:
        """Go on with the same structure in another place."""
        before, there = self.system.arithmetic, system.arithmetic
        self.system, self._factor = system, None
        self.motion = self.motion.moved(lambda values: there.brought(before.on_host(values)))

    @property
    def share_of_begin(self) -> float:
        """Weight of the begin of a step in the forces that the method averages; the end has the rest."""
        return self._averages.af

    def advance(self, time: float, load: Load | None = None, *, accounted: bool = True) -> Motion:
        """Go on to ``time`` [s] under ``load`` at that instant, with or without an account of energy.

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
            self._divide(target, self._blend(first, load, share), self.settings.halvings, accounted)
        return self.motion

    def restore(self, motion: Motion) -> None:
        """Continue from a stored instant; every continuation from it repeats bit for bit."""
        self.motion, self._factor = motion, None

    def amend(self, motion: Motion) -> None:
        """Replace the newest instant, as contacts do, without forgetting the factorised tangent."""
        self.motion = motion

    def _no_load(self, c: Configuration) -> FloatArray:
        return self.system.arithmetic.zeros(self.system.rows, 3)

    def _begin(self, c: Configuration, time: float, load: Load) -> Motion:
        s = self.system
        driven, carrier = s.drive.at(time), s.drive.carrier(time)
        hold(s, c, driven)
        force, internal, zero = load(c), s.internal(c), s.arithmetic.zeros(s.rows, 3)
        missing = s.unbalanced(s.places.every, c, carrier, s.inertial(c, zero), internal, force)
        acceleration = s.solve_inertia(c, -missing)
        hold_acceleration(s, acceleration, driven)
        reaction = s.unbalanced(s.places.held, c, carrier, s.inertial(c, acceleration), internal, force)
        stored = s.kinetic(c), s.elastic(c)
        energies = Energies(stored[0], stored[1], 0.0, 0.0, 0.0, 0.0, sum(stored))
        return Motion(time, c, acceleration, acceleration.copy(), force, reaction, energies)

    def _divide(self, target: float, load: Load, halvings: int, accounted: bool) -> None:
        """One step to ``target``, halved until it converges."""
        try:
            with np.errstate(all="ignore"):  # an iterate that runs away is found by its residual
                self.motion = self._step(target, load, accounted)
        except _NotConvergedError:
            if halvings == 0:
                raise WorkError(
                    f"wing structure: no equilibrium at t = {target:.6g} s even with a step of "
                    f"{target - self.motion.time:.2g} s; lower the load or raise integration.iterations"
                ) from None
            self.counters.halvings += 1
            begin = self.motion
            middle = 0.5 * (begin.time + target)
            self._divide(middle, self._blend(begin.force, load, 0.5), halvings - 1, accounted)
            self._divide(target, load, halvings - 1, accounted)

    def _step(self, target: float, load: Load, accounted: bool) -> Motion:
        s = self.system
        trial = Trial(s, self._averages, self.motion, target)
        before, fresh = np.inf, False
        for iteration in range(self.settings.iterations + 1):
            forces = trial.forces(load)
            free = trial.unbalanced(s.places.free, forces)
            size, *scales = s.arithmetic.largest(free, *forces)
            if not np.isfinite(size):
                raise _NotConvergedError
            if size <= max(self.settings.tolerance * max(scales), self._floor):
                self.counters.steps += 1
                return trial.finished(forces, accounted)
            if iteration == self.settings.iterations:
                raise _NotConvergedError
            slow = size > self.settings.slowest_contraction * before and not fresh
            factor, fresh = self._factor, False
            if factor is None or factor.stale(trial.step) or slow:
                factor = self._factor = self._factorised(trial)
                fresh = True
            before = size
            self.counters.iterations += 1
            trial.correct(factor.solve(free, trial.carrier))
        raise _NotConvergedError

    def _factorised(self, trial: Trial) -> CarriedFactors:
        self._factor = None  # only the newest factors of a system are kept
        rate, ratio = trial.rates
        begin = self.motion.configuration
        try:
            factors = self.system.factors(trial.c, rate=rate, mass_factor=ratio, stressed=begin)
        except RuntimeError:
            raise _NotConvergedError from None
        self.counters.factorisations += 1
        return CarriedFactors(factors, self.system, trial.carrier, trial.step)

    def _blend(self, first: FloatArray, load: Load, share: float) -> Load:
        """Load at a share of the way from ``first`` to ``load``."""
        if share >= 1.0:
            return load
        arithmetic, rows = self.system.arithmetic, self.system.rows

        def blended(c: Configuration) -> FloatArray:
            out = arithmetic.empty(rows, 3)
            arithmetic.run(between, rows, share, first, load(c), out)
            return out

        return blended
