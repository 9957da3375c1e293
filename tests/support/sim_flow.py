# SPDX-License-Identifier: Apache-2.0
"""Air that never flows: a stand-in for the solver, for tests of what is done around it."""

from __future__ import annotations

import types

import numpy as np

from cwmav_sim.sph.timers import Timers


class StillFlow:
    """Air at rest that steps 100 times per cycle of 16 Hz; subclasses say its loads by :meth:`loads`."""

    steps_per_second = 1600.0

    def __init__(self, flow, motion, airspeed, **options):
        del flow, airspeed, options
        self.motion, self.particles, self.steps, self.time = motion, 1000, 0, 0.0
        self.timers, self.identity, self.crossings = Timers(), np.arange(self.particles), 0
        self.wall_impulse = self.fringe_impulse = self.gravity_impulse = np.zeros(3)
        self.fringe_work = 0.0

    def loads(self, time):
        """Pressure force, viscous force (panels, 3) [N] and power (panels,) [W] at a time [s]."""
        return np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(2)

    def step(self):
        self.steps += 1
        self.time = self.steps / self.steps_per_second
        pressure, viscous, power = self.loads(self.time)
        return types.SimpleNamespace(
            time=self.time,
            dt=1.0 / self.steps_per_second,
            pressure=pressure,
            viscous=viscous,
            power=power,
            moment=0.01 * pressure,
        )

    @property
    def sheet(self):
        return self.motion.state(self.time)

    def momentum(self):
        return np.zeros(3)

    def kinetic_energy(self):
        return 0.0

    def pairs(self):
        return 100 * self.particles

    def save(self):
        return {"steps": np.array(self.steps)}

    def restore(self, saved):
        self.steps = int(saved["steps"])
        self.time = self.steps / self.steps_per_second
