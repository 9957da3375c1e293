# SPDX-License-Identifier: Apache-2.0
"""The time loop of air and wings."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import WorkError
from cwmav_sim.memory import keep_freed_memory
from cwmav_sim.sph.cells import make_grid
from cwmav_sim.sph.crossing import Crossings, passed_through, put_back
from cwmav_sim.sph.easing import ease
from cwmav_sim.sph.eos import Tait
from cwmav_sim.sph.integrate import correct, predict
from cwmav_sim.sph.interaction import Interaction
from cwmav_sim.sph.plain import PlainInteraction
from cwmav_sim.sph.rates import Rates
from cwmav_sim.sph.settings import FlowSettings
from cwmav_sim.sph.sheet import Compliant, Motion, Nodes, Solid, expected_speed
from cwmav_sim.sph.state import Particles, lattice
from cwmav_sim.sph.stream import relax
from cwmav_sim.sph.surfaces import Sides
from cwmav_sim.sph.timers import Timers
from cwmav_sim.sph.timestep import largest_length, stable_step

FloatArray = NDArray[np.float64]

# Storage follows space again after this many steps, so that neighbours lie near each other in memory.
REORDER_EVERY = 50

# What a saved state holds besides the particles.
_SIDES = ("signed", "inside", "normal")
TALLIES = (
    "time",
    "steps",
    "crossings",
    "wall_impulse",
    "fringe_impulse",
    "gravity_impulse",
    "fringe_work",
)


@dataclass(frozen=True)
class StepInfo:
    """What one step did; forces are those between its begin and its end.

    Attributes
    ----------
    time, dt : float
        Time at the end of the step and its length [s].
    pressure, viscous : ndarray, shape (panels, 3)
        Forces of the air on every panel [N], wind frame.
    power : ndarray, shape (panels,)
        Power every panel gives to the air [W].
    moment : ndarray, shape (panels, 3)
        Moments of the air on every panel about the origin [N m].
    crossings : int
        Particles that crossed a wall in this step: the safety net put them back, or walls of particles let
        them pass.
    """

    time: float
    dt: float
    pressure: FloatArray
    viscous: FloatArray
    power: FloatArray
    moment: FloatArray
    crossings: int


class Solver:
    """Weakly compressible air around moving walls without thickness.

    Parameters
    ----------
    settings : FlowSettings
        Numerics of the air.
    motion : Motion or None
        The walls; None for air alone. One that is :class:`Solid` too keeps the air out of its inside.
    airspeed : float
        Speed of the stream along x [m/s].
    highest_speed : float, optional
        Highest speed to expect [m/s]; it sets the speed of sound. By default that of the stream and of the
        walls over ``motion.period``, or over the first second of a motion without one.
    """

    def __init__(
        self,
        settings: FlowSettings,
        motion: Motion | None,
        airspeed: float,
        *,
        highest_speed: float | None = None,
    ) -> None:
        self._settings, self._motion = settings, motion
        self._wings: Compliant | None = motion if isinstance(motion, Compliant) else None
        self._stream = np.array([airspeed, 0.0, 0.0])
        resolution, fluid = settings.resolution, settings.fluid
        self._h = resolution.h_over_dp * resolution.dp
        self._speed = highest_speed if highest_speed is not None else expected_speed(motion, airspeed)
        self.sound_speed = fluid.effective_sound_speed(self._speed)
        self._eos = Tait(fluid.density, self.sound_speed, fluid.gamma, fluid.background_pressure)
        self._air, low, size = lattice(settings.box, resolution, fluid.density, self._stream)
        walls: object = motion
        if isinstance(walls, Solid):
            self._air = self._air.without(walls.holds(self._air.x))
        self._grid = make_grid(
            low, size, self._h, mirrored=settings.box.symmetric, dimensions=settings.box.dimensions
        )
        self.timers = Timers()
        plain = settings.sheet.treatment == "dbc" and motion is not None
        interaction = PlainInteraction if plain else Interaction
        self._interaction = interaction(settings, self._grid, self._eos, motion, self.timers)
        self._dt = stable_step(resolution.cfl, self._h, self.sound_speed, 0.0, fluid.viscosity)
        self._sides: Sides | None = None
        keep_freed_memory()
        self.time = 0.0
        self.steps = 0
        self.crossings = 0
        self.wall_impulse = np.zeros(3)
        self.fringe_impulse = np.zeros(3)
        self.gravity_impulse = np.zeros(3)
        self.fringe_work = 0.0

    def step(self) -> StepInfo:
        """Advance by one time step.

        Raises
        ------
        WorkError
            When the flow blows up.
        """
        dt = self._dt
        if self.steps % REORDER_EVERY == 0:
            self._reorder()
        rates, crossed = self._rates_on_own_side(dt)
        self._foresee(rates, dt)
        self._interaction.predict_walls(dt)
        middle = predict(self._air, rates, dt)
        self._confine(middle)
        nodes = self._nodes(self.time + 0.5 * dt)
        middle_rates = self._interaction.rates(
            middle, nodes, shifting=True, reactions=self._wings is not None
        )
        self._interaction.correct_walls(dt)
        with self.timers.phase("update"):
            self._air = correct(self._air, middle, middle_rates, dt)
            ease(self._air.x, middle_rates, self._settings, self._h, self._speed, dt)
            self._relax(dt)
            self._confine(self._air)
            self._sides = rates.sides
            self._dt = self._next_step(rates, middle_rates, nodes)
        if self._wings is not None and nodes is not None:
            with self.timers.phase("structure"):
                load = self._interaction.sheet_load(middle_rates, nodes, crossed, dt)
                self._wings.accept(self.time + dt, load)
        self.time += dt
        self.steps += 1
        self.crossings += int(crossed.count.sum())
        pressure = middle_rates.pressure + crossed.impulse / dt
        self.wall_impulse += dt * (pressure + middle_rates.viscous).sum(axis=0)
        self.gravity_impulse[2] -= dt * self._settings.fluid.gravity * self._air.mass * self.particles
        return StepInfo(
            self.time,
            dt,
            pressure,
            middle_rates.viscous,
            middle_rates.power,
            middle_rates.moment,
            int(crossed.count.sum()),
        )

    def _rates_on_own_side(self, dt: float) -> tuple[Rates, Crossings]:
        """Rates at the begin of a step, after putting back whatever slipped through a wall."""
        panels = self._interaction.panels
        rates = self._begin_rates()
        if self._sides is None or panels == 0:
            return rates, Crossings.none(panels)
        dp = self._settings.resolution.dp
        if not self._interaction.holds_air:
            return rates, passed_through(self._sides, rates.sides, panels, dp)
        crossed = put_back(self._air, self._sides, rates.sides, panels, dp, dt)
        if crossed.count.any():
            self._confine(self._air)
            rates = self._begin_rates()
        return rates, crossed

    def _begin_rates(self) -> Rates:
        nodes, wanted = self._nodes(self.time), self._wings is not None
        return self._interaction.rates(self._air, nodes, shifting=False, reactions=wanted)

    def _foresee(self, rates: Rates, dt: float) -> None:
        """Let compliant walls foresee their motion in this step from the load at its begin."""
        if self._wings is None:
            return
        nodes = self._nodes(self.time)
        if nodes is not None:
            with self.timers.phase("structure"):
                self._wings.foresee(self.time + dt, self._interaction.sheet_load(rates, nodes))

    def _nodes(self, t: float) -> Nodes | None:
        return None if self._motion is None else self._motion.state(t)

    def _reorder(self) -> None:
        order = self._interaction.storage_order(self._air)
        self._air.reorder(order)
        if self._sides is not None:
            self._sides = self._sides.take(order)

    def _relax(self, dt: float) -> None:
        fringe, air = self._settings.fringe, self._air
        if fringe.width == 0.0:
            return
        begin = float(self._grid.low[0] + self._grid.size[0]) - fringe.width
        rho0 = self._settings.fluid.density
        around = np.array([self._grid.low[2], self._grid.size[2] if fringe.around else 0.0])
        parts = relax(air.x, air.v, air.rho, begin, fringe.width, fringe.rate, self._stream, rho0, dt, around)
        change = parts.sum(axis=0)
        self.fringe_impulse += air.mass * change[:3]
        self.fringe_work += air.mass * float(change[3])

    def _confine(self, air: Particles) -> None:
        """Bring particles that left the box back: around its periodic faces, off its mirrors."""
        if self._grid.mirrored:
            self._grid.reflect(air.x, air.v)
        self._grid.wrap(air.x)

    def _next_step(self, first: Rates, second: Rates, nodes: Nodes | None) -> float:
        speed = largest_length(self._air.v)
        if not math.isfinite(speed) or not np.isfinite(self._air.rho).all():
            raise WorkError(
                f"the air became undefined at t = {self.time:.6g} s, step {self.steps}, dt = {self._dt:.3g} s"
            )
        if nodes is not None:
            speed = max(speed, largest_length(nodes.v))
        acceleration = max(largest_length(first.acceleration), largest_length(second.acceleration))
        # Speeds beyond the expected ones shorten the step as a higher speed of sound would.
        signal = max(self.sound_speed, speed / self._settings.fluid.mach_limit)
        cfl, viscosity = self._settings.resolution.cfl, self._settings.fluid.viscosity
        return stable_step(cfl, self._h, signal, acceleration, viscosity)

    @property
    def particles(self) -> int:
        """Number of particles; none is ever lost."""
        return self._air.count

    @property
    def position(self) -> FloatArray:
        """Positions of the particles [m], shape (n, 3)."""
        return self._air.x

    @property
    def velocity(self) -> FloatArray:
        """Velocities of the particles [m/s], shape (n, 3)."""
        return self._air.v

    @property
    def density(self) -> FloatArray:
        """Densities of the particles [kg/m3], shape (n,)."""
        return self._air.rho

    @property
    def pressure(self) -> FloatArray:
        """Pressures of the particles, background included [Pa], shape (n,)."""
        return self._eos.pressure(self._air.rho)

    @property
    def identity(self) -> NDArray[np.int64]:
        """Numbers of the particles, in their present order, shape (n,)."""
        return self._air.identity

    def set_pressure(self, pressure: FloatArray) -> None:
        """Give the particles the densities that belong to pressures [Pa] without background, shape (n,)."""
        self._air.rho[:] = self._eos.density_at(pressure)

    @property
    def sheet(self) -> Nodes | None:
        """Nodes of the walls at the time reached; None without walls."""
        return self._nodes(self.time)

    def momentum(self) -> FloatArray:
        """Momentum of the air [kg m/s], shape (3,)."""
        return self._air.momentum()

    def kinetic_energy(self) -> float:
        """Kinetic energy of the air [J]."""
        return 0.5 * self._air.mass * float(np.einsum("ij,ij->", self._air.v, self._air.v))

    def save(self) -> dict[str, NDArray]:
        """Return everything of the air and its walls that is needed to go on from here, by name.

        Wings that move by themselves keep their own state.
        """
        air = self._air
        out = {"x": air.x, "v": air.v, "rho": air.rho, "identity": air.identity}
        if self._sides is not None:
            for name in _SIDES:
                out[f"sides.{name}"] = getattr(self._sides, name)
        for name in TALLIES:
            out[name] = np.array(getattr(self, name))
        out["dt"] = np.array(self._dt)
        return out | {f"walls.{name}": value for name, value in self._interaction.save().items()}

    def restore(self, saved: dict[str, NDArray]) -> None:
        """Go to a saved state of a solver made with the same settings."""
        air = self._air
        self._air = Particles(saved["x"], saved["v"], saved["rho"], air.mass, saved["identity"])
        if "sides.signed" in saved:
            self._sides = Sides(*(saved[f"sides.{name}"] for name in _SIDES))
        for name in TALLIES:
            value = saved[name]
            setattr(self, name, value.copy() if value.ndim else value.item())
        self._dt = float(saved["dt"])
        prefix = "walls."
        self._interaction.restore(
            {name.removeprefix(prefix): value for name, value in saved.items() if name.startswith(prefix)}
        )

    def pairs(self) -> int:
        """Ordered pairs of particles within the support, as one pass sums them."""
        return self._interaction.pairs(self._air)
