# SPDX-License-Identifier: Apache-2.0
"""The time loop on a graphics card, with the interface of ``cwmav_sim.solver``.

Particles, their rates and their sides stay on the card. In every step the host receives the number of
particles that slipped through a wall, then about a hundred bytes: largest speed and acceleration, wall loads,
fringe. It sends the nodes of prescribed walls; flexible wings are computed on the card
(:mod:`cwmav_sim.cuda.structure`), where the host only steers Newton's iterations.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import WorkError
from cwmav_sim.cuda.air import CardAir
from cwmav_sim.cuda.cells import floats
from cwmav_sim.cuda.coupled import walls_of
from cwmav_sim.cuda.crossing import Net
from cwmav_sim.cuda.integrate import (
    ACCELERATION2,
    CHANGE_X,
    CORRECTION_ROWS,
    LARGEST_ROWS,
    SPEED2,
    WORK,
    confine_all,
    correct,
    predict,
    reorder,
)
from cwmav_sim.cuda.launch import blocks, empty, launch
from cwmav_sim.cuda.scan import reduce_blocks
from cwmav_sim.cuda.state import CardParticles
from cwmav_sim.solver import REORDER_EVERY, StepInfo
from cwmav_sim.sph.crossing import Crossings
from cwmav_sim.sph.forces import LOAD_SIZE
from cwmav_sim.sph.rates import as_rates
from cwmav_sim.sph.settings import FlowSettings
from cwmav_sim.sph.sheet import Motion, Nodes
from cwmav_sim.sph.surfaces import Sides
from cwmav_sim.sph.timestep import stable_step

FloatArray = NDArray[np.float64]

# Places in what the host reads after a step: largest squared acceleration at its begin, then what the
# correction leaves, then the wall loads.
_BEGIN_ACCELERATION2, _CORRECTION = 0, 1
_LOADS = _CORRECTION + CORRECTION_ROWS


class CudaSolver(CardAir):
    """Weakly compressible air around moving walls without thickness, computed on a graphics card.

    Parameters
    ----------
    settings, motion, airspeed, highest_speed
        As of :class:`cwmav_sim.solver.Solver`.

    Raises
    ------
    InputError
        For settings that only the CPU can compute.
    """

    def __init__(
        self,
        settings: FlowSettings,
        motion: Motion | None,
        airspeed: float,
        *,
        highest_speed: float | None = None,
    ) -> None:
        super().__init__(settings, motion, airspeed, highest_speed)
        self._motion, self._walls = motion, walls_of(motion, self._interaction)
        count, panels, box = self._count, self._interaction.panels, settings.box
        self._middle = CardParticles.room(count)
        self._begin_sides, self._middle_sides = self._interaction.sides(), self._interaction.sides()
        self._net = Net(count, panels, settings.resolution.dp)
        self._partial = empty((CORRECTION_ROWS, blocks(count)))
        self._summary = empty(_LOADS + panels * LOAD_SIZE)
        self._correction_k = self._constants(airspeed)
        self._box = floats(self._grid.low), floats(self._grid.size), box.symmetric

    def _constants(self, airspeed: float) -> tuple[float, ...]:
        settings, low, size = self._settings, self._grid.low, self._grid.size
        dp, fringe = settings.resolution.dp, settings.fringe
        return (
            settings.shifting.limit * dp,
            dp,
            settings.sheet.keep_out * dp,
            float(low[0] + size[0]) - fringe.width,
            fringe.width,
            fringe.rate,
            airspeed,
            settings.fluid.density,
            float(low[2]),
            float(size[2]) if fringe.around else 0.0,
        )

    def step(self) -> StepInfo:
        """Advance by one time step.

        Raises
        ------
        WorkError
            When the flow blows up.
        """
        dt, panels, walls = self._dt, self._interaction.panels, self._walls
        crossed = Crossings.none(panels)
        compliant = walls is not None and walls.compliant
        with self.timers.phase("launch"):
            if self.steps % REORDER_EVERY == 0:
                self._reorder()
            self._begin_rates()
            check = self._know_sides and panels > 0
            if check:
                self._net.put_back(self._air.x, self._air.v, self._sides, self._begin_sides, self._mass, dt)
        if compliant:
            if check:
                crossed = self._caught(dt)
            self._foresee(dt)
        nodes = self._middle_rates(dt)
        if not compliant and check:
            # Almost always nothing was caught, so the card need not wait for the host to know.
            crossed = self._caught(dt)
            if crossed.count.any():
                self._middle_rates(dt)
        with self.timers.phase("launch"):
            self._correct(dt)
        with self.timers.phase("card"):
            summary = self._summary.copy_to_host()
        self._sides, self._begin_sides = self._begin_sides, self._sides
        self._know_sides = True
        self._dt = self._next_step(summary, nodes)
        if compliant and walls is not None and nodes is not None:
            with self.timers.phase("structure"):
                walls.accept(self.time + dt, nodes, crossed, dt)
        return self._account(summary, crossed, dt)

    def _account(self, summary: FloatArray, crossed: Crossings, dt: float) -> StepInfo:
        """Close the books of a step."""
        self.time += dt
        self.steps += 1
        found = int(crossed.count.sum())
        self.crossings += found
        rates = as_rates(
            np.zeros((0, 3)),
            np.zeros(0),
            np.zeros((0, 3)),
            summary[_LOADS:].reshape(-1, LOAD_SIZE),
            Sides.empty(0, 0, self._interaction.host.dtype),
        )
        pressure = rates.pressure + crossed.impulse / dt
        self.wall_impulse += dt * (pressure + rates.viscous).sum(axis=0)
        self.gravity_impulse[2] -= dt * self._settings.fluid.gravity * self._mass * self._count
        change = _CORRECTION + CHANGE_X
        self.fringe_impulse += self._mass * summary[change : change + 3]
        self.fringe_work += self._mass * float(summary[_CORRECTION + WORK])
        return StepInfo(self.time, dt, pressure, rates.viscous, rates.power, rates.moment, found)

    def _reorder(self) -> None:
        order = self._interaction.storage_order(self._air)
        old, new = self._air, self._middle
        launch(
            reorder,
            self._count,
            order,
            old.x,
            old.v,
            old.rho,
            old.identity,
            self._sides,
            new.x,
            new.v,
            new.rho,
            new.identity,
            self._begin_sides,
        )
        self._air, self._middle = new, old
        self._sides, self._begin_sides = self._begin_sides, self._sides

    def _begin_rates(self) -> None:
        nodes = self._nodes(self.time)
        self._interaction.rates(
            self._air, nodes, self._begin_sides, shifting=False, reactions=self._reactions
        )

    @property
    def _reactions(self) -> bool:
        return self._walls is not None and self._walls.compliant

    def _caught(self, dt: float) -> Crossings:
        """Return what slipped through a wall in the step before; if anything did, find the rates anew."""
        with self.timers.phase("card"):
            crossed = self._net.caught(self._air.x, dt)
        if crossed.count.any():
            launch(confine_all, self._count, self._air.x, self._air.v, *self._box)
            self._begin_rates()
        return crossed

    def _middle_rates(self, dt: float) -> Nodes | None:
        """Predict the particles and find their rates; return the nodes of the walls there."""
        with self.timers.phase("launch"):
            self._predict(dt)
            nodes = self._nodes(self.time + 0.5 * dt)
            self._interaction.rates(
                self._middle, nodes, self._middle_sides, shifting=True, reactions=self._reactions
            )
        return nodes

    def _foresee(self, dt: float) -> None:
        nodes = self._nodes(self.time)
        if self._walls is not None and nodes is not None:
            with self.timers.phase("structure"):
                self._walls.foresee(self.time + dt, nodes)

    def _predict(self, dt: float) -> None:
        air, middle, rates = self._air, self._middle, self._interaction
        launch(
            predict,
            self._count,
            air.x,
            air.v,
            air.rho,
            rates.acceleration,
            rates.density_rate,
            0.5 * dt,
            *self._box,
            middle.x,
            middle.v,
            middle.rho,
            self._partial,
        )
        reduce_blocks(self._partial[:1], 1, self._summary, _BEGIN_ACCELERATION2)

    def _correct(self, dt: float) -> None:
        air, rates = self._air, self._interaction
        launch(
            correct,
            self._count,
            air.x,
            air.v,
            air.rho,
            self._middle.rho,
            rates.acceleration,
            rates.density_rate,
            rates.shift,
            self._middle_sides,
            dt,
            self._settings.shifting.coefficient * self._h * self._speed * dt,
            self._correction_k,
            *self._box,
            self._partial,
        )
        reduce_blocks(self._partial, LARGEST_ROWS, self._summary, _CORRECTION)
        rates.sum_loads(self._summary, _LOADS)

    def _next_step(self, summary: FloatArray, nodes: Nodes | None) -> float:
        speed = math.sqrt(summary[_CORRECTION + SPEED2])
        if not math.isfinite(speed):
            raise WorkError(
                f"the air became undefined at t = {self.time:.6g} s, step {self.steps}, dt = {self._dt:.3g} s"
            )
        if self._walls is not None and nodes is not None:
            speed = max(speed, self._walls.fastest(nodes))
        acceleration = math.sqrt(max(summary[_BEGIN_ACCELERATION2], summary[_CORRECTION + ACCELERATION2]))
        signal = max(self.sound_speed, speed / self._settings.fluid.mach_limit)
        cfl, viscosity = self._settings.resolution.cfl, self._settings.fluid.viscosity
        return stable_step(cfl, self._h, signal, acceleration, viscosity)

    @property
    def sheet(self) -> Nodes | None:
        """Nodes of the walls at the time reached, on the host; None without walls."""
        return None if self._motion is None else self._motion.state(self.time)

    def _nodes(self, t: float) -> Nodes | None:
        return None if self._walls is None else self._walls.nodes(t)
