# SPDX-License-Identifier: Apache-2.0
"""Rates of change of all particles among walls of the plain kind (see ``dynamic``)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cwmav_sim.sph import forces
from cwmav_sim.sph.cells import Grid, Sorting, sort_into_cells
from cwmav_sim.sph.dynamic import DynamicWall
from cwmav_sim.sph.eos import Tait
from cwmav_sim.sph.gather import buffer_room
from cwmav_sim.sph.interaction import Interaction
from cwmav_sim.sph.plain_pass import air_pass, wall_pass
from cwmav_sim.sph.rates import Rates, as_rates
from cwmav_sim.sph.settings import FlowSettings
from cwmav_sim.sph.sheet import Motion, Nodes
from cwmav_sim.sph.state import FloatArray, Particles
from cwmav_sim.sph.surfaces import Sides, locate_surfaces
from cwmav_sim.sph.timers import Timers


class PlainInteraction(Interaction):
    """The sums over neighbours and over the wall particles of dynamic walls; parameters as its base."""

    holds_air = False

    def __init__(
        self, settings: FlowSettings, grid: Grid, eos: Tait, motion: Motion | None, timers: Timers
    ) -> None:
        super().__init__(settings, grid, eos, motion, timers)
        if motion is None:
            raise ValueError("walls of particles need walls")
        self._wall = DynamicWall.on(
            motion, settings.resolution.dp, settings.fluid.density, settings.box.dimensions
        )
        self._dimensions = settings.box.dimensions
        self._middle = False
        self._wall_rate: FloatArray = np.zeros(len(self._wall.panel))

    def predict_walls(self, dt: float) -> None:
        """Bring the densities of the wall to half the step of ``dt`` [s]."""
        self._wall.predict(self._wall_rate, dt)
        self._middle = True

    def correct_walls(self, dt: float) -> None:
        """Bring the densities of the wall over the step."""
        self._wall.correct(self._wall_rate, dt)
        self._middle = False

    def save(self) -> dict[str, NDArray]:
        """Return the densities of the wall and their rates."""
        wall = self._wall
        return {"density": wall.density, "middle": wall.middle, "rate": self._wall_rate}

    def restore(self, saved: dict[str, NDArray]) -> None:
        """Go to saved densities."""
        self._wall.density, self._wall.middle = saved["density"], saved["middle"]
        self._wall_rate = saved["rate"]

    def _walled(
        self,
        particles: Particles,
        nodes: Nodes,
        sorting: Sorting,
        fluid: NDArray,
        column: NDArray,
        shifting: bool,
        reactions: bool,
    ) -> Rates:
        with self._timers.phase("walls"):
            wall = self._wall.placed(nodes, self._middle, self._dimensions)
            arm = wall.x.copy()
            self._grid.wrap(wall.x)
            wall_sorting = sort_into_cells(wall.x, self._grid)
            packed = self._pack(wall, wall_sorting)
            wall_column = wall_sorting.column.astype(self.dtype)
        with self._timers.phase("pairs"):
            n = particles.count
            acceleration, density_rate, shift = np.empty((n, 3)), np.empty(n), np.empty((n, 3))
            wall_rate, force = np.empty(wall.count), np.zeros((forces.LOAD_SIZE, wall.count))
            scale = self._scale.copy()
            scale[forces.MASS] = particles.mass
            air = (fluid, column, sorting.order, sorting.start)
            solid = (packed, wall_column, wall_sorting.order, wall_sorting.start)
            constants = (self._grid.integers, self._grid.cell.astype(self.dtype), self._pair_k, scale)
            room = buffer_room(sorting.start, self._grid.integers)
            wall_room = buffer_room(wall_sorting.start, self._grid.integers)
            air_pass(
                *air,
                *solid,
                *constants,
                shifting,
                self._keep_diffusion,
                room,
                wall_room,
                self._orders,
                acceleration,
                density_rate,
                shift,
            )
            wall_pass(*air, *solid, *constants, room, self._orders, wall_rate, force)
        self._wall_rate = wall_rate
        total = force[0:3] + force[3:6]
        force[8:11] = np.cross(arm, total.T).T
        by_panel = np.zeros((self.panels, forces.LOAD_SIZE))
        np.add.at(by_panel, self._wall.panel, force.T)
        sides = Sides.empty(self.panels, n, self.dtype)  # walls of particles hide nothing
        self._add_subgrid_stress(acceleration, particles, sorting, fluid, column, sides)
        self._add_gravity(acceleration)
        if not self._middle:  # what passed is counted at the begin; those of the middle would ease air away
            with self._timers.phase("walls"):
                sides = self._sides(nodes, fluid, column, sorting)
        # The force does not depend on the wall's acceleration, so no air is carried along within a pass.
        reaction = np.vstack([total, np.zeros(wall.count)]) if reactions else None
        return replace(as_rates(acceleration, density_rate, shift, by_panel, sides), reaction=reaction)

    def _sides(self, nodes: Nodes, fluid: NDArray, column: NDArray, sorting: Sorting) -> Sides:
        """Return where the air lies with respect to the walls, to count what passes through them."""
        assert self.quadrature is not None  # noqa: S101 - for the type checker
        placed = self.quadrature.place(nodes)
        surfaces = locate_surfaces(self.quadrature, placed, self._grid, fluid, column, sorting.start)
        return surfaces.particle_sides.in_storage_order(
            self.panels, sorting.order, sorting.start, surfaces.near_any
        )

    def _shares(self, nodes: int) -> sp.csr_matrix:
        return self._wall.weights(nodes)
