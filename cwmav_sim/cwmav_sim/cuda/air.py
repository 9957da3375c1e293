# SPDX-License-Identifier: Apache-2.0
"""The air on the card, and all that can be asked of it between steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cwmav_sim.cuda.integrate import half_squares
from cwmav_sim.cuda.interaction import CardInteraction
from cwmav_sim.cuda.launch import CardArray, blocks, empty, launch, upload
from cwmav_sim.cuda.scan import reduce_blocks
from cwmav_sim.cuda.state import CardParticles
from cwmav_sim.solver import TALLIES
from cwmav_sim.sph.cells import make_grid
from cwmav_sim.sph.eos import Tait
from cwmav_sim.sph.settings import FlowSettings
from cwmav_sim.sph.sheet import Motion, Solid, expected_speed
from cwmav_sim.sph.state import Particles, lattice
from cwmav_sim.sph.timers import Timers
from cwmav_sim.sph.timestep import stable_step

FloatArray = NDArray[np.float64]


class CardAir:
    """Particles, their interaction and what is kept account of.

    Parameters
    ----------
    settings, motion, airspeed, highest_speed
        As of :class:`cwmav_sim.solver.Solver`.
    """

    def __init__(
        self, settings: FlowSettings, motion: Motion | None, airspeed: float, highest_speed: float | None
    ) -> None:
        self._settings = settings
        resolution, fluid = settings.resolution, settings.fluid
        self._h = resolution.h_over_dp * resolution.dp
        self._speed = highest_speed if highest_speed is not None else expected_speed(motion, airspeed)
        self.sound_speed = fluid.effective_sound_speed(self._speed)
        self._eos = Tait(fluid.density, self.sound_speed, fluid.gamma, fluid.background_pressure)
        air, low, size = lattice(settings.box, resolution, fluid.density, np.array([airspeed, 0.0, 0.0]))
        walls: object = motion
        if isinstance(walls, Solid):
            air = air.without(walls.holds(air.x))
        self._mass, self._count = air.mass, air.count
        self._grid = make_grid(
            low, size, self._h, mirrored=settings.box.symmetric, dimensions=settings.box.dimensions
        )
        self._interaction = CardInteraction(settings, self._grid, self._eos, motion, air.count, air.mass)
        self._air = CardParticles.of(air)
        self._sides = self._interaction.sides()
        self._know_sides = False
        self._dt = stable_step(resolution.cfl, self._h, self.sound_speed, 0.0, fluid.viscosity)
        self.timers = Timers()
        self.time = 0.0
        self.steps = 0
        self.crossings = 0
        self.wall_impulse = np.zeros(3)
        self.fringe_impulse = np.zeros(3)
        self.gravity_impulse = np.zeros(3)
        self.fringe_work = 0.0

    @property
    def particles(self) -> int:
        """Number of particles; none is ever lost."""
        return self._count

    @property
    def position(self) -> FloatArray:
        """Copy of the positions of the particles [m], shape (n, 3)."""
        return _rows(self._air.x)

    @property
    def velocity(self) -> FloatArray:
        """Copy of the velocities of the particles [m/s], shape (n, 3)."""
        return _rows(self._air.v)

    @property
    def density(self) -> FloatArray:
        """Copy of the densities of the particles [kg/m3], shape (n,)."""
        return np.asarray(self._air.rho.copy_to_host())

    @property
    def pressure(self) -> FloatArray:
        """Pressures of the particles, background included [Pa], shape (n,)."""
        return self._eos.pressure(self.density)

    @property
    def identity(self) -> NDArray[np.int64]:
        """Numbers of the particles, in their present order, shape (n,)."""
        return np.asarray(self._air.identity.copy_to_host())

    def set_pressure(self, pressure: FloatArray) -> None:
        """Give the particles the densities that belong to pressures [Pa] without background, shape (n,)."""
        self._air.rho = upload(self._eos.density_at(pressure))

    def momentum(self) -> FloatArray:
        """Momentum of the air [kg m/s], shape (3,)."""
        return self._mass * self._sums()[:3]

    def kinetic_energy(self) -> float:
        """Kinetic energy of the air [J]."""
        return self._mass * float(self._sums()[3])

    def _sums(self) -> FloatArray:
        """Return the sums of the velocities (3) and of half their squares, taken on the card."""
        out, partial = empty(4), empty((4, blocks(self._count)))
        launch(half_squares, self._count, self._air.v, partial)
        reduce_blocks(partial, 0, out, 0)
        return np.asarray(out.copy_to_host())

    def save(self) -> dict[str, NDArray]:
        """Return everything of the air that is needed to go on from here, named as by the CPU's solver."""
        out = {"x": self.position, "v": self.velocity, "rho": self.density, "identity": self.identity}
        if self._know_sides:
            sides = self._sides.copy_to_host()
            out |= {
                "sides.signed": sides[:, 0].copy(),
                "sides.inside": sides[:, 1].copy(),
                "sides.normal": sides[:, 2:].copy(),
            }
        for name in TALLIES:
            out[name] = np.array(getattr(self, name))
        out["dt"] = np.array(self._dt)
        return out

    def restore(self, saved: dict[str, NDArray]) -> None:
        """Go to a saved state, also one that the CPU's solver saved, of a solver with the same settings."""
        self._air = CardParticles.of(
            Particles(saved["x"], saved["v"], saved["rho"], self._mass, saved["identity"])
        )
        self._know_sides = "sides.signed" in saved
        if self._know_sides:
            flat = np.stack([saved["sides.signed"], saved["sides.inside"]], axis=1)
            self._sides = upload(np.concatenate([flat, saved["sides.normal"]], axis=1))
        for name in TALLIES:
            value = saved[name]
            setattr(self, name, value.copy() if value.ndim else value.item())
        self._dt = float(saved["dt"])

    def pairs(self) -> int:
        """Ordered pairs of particles within the support, as one pass sums them; counted on the host."""
        return self._interaction.host.pairs(
            Particles(self.position, self.velocity, self.density, self._mass, self.identity)
        )


def _rows(array: CardArray) -> FloatArray:
    return np.ascontiguousarray(array.copy_to_host().T)
