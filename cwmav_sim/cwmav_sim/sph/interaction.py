# SPDX-License-Identifier: Apache-2.0
"""Rates of change of all particles for one state of the air and of the walls.

Here positions become cells, walls become elements, and the passes of ``forces`` and ``walled`` are called.
Callers keep their particles in storage order; what the passes see is sorted by cell and packed in the
precision of the pairs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cwmav_sim.sph import forces, walled
from cwmav_sim.sph.around import REACTION_SIZE
from cwmav_sim.sph.blocks import lane_orders
from cwmav_sim.sph.cells import Grid, Sorting, sort_into_cells
from cwmav_sim.sph.crossing import Crossings
from cwmav_sim.sph.eos import Tait
from cwmav_sim.sph.gather import buffer_room
from cwmav_sim.sph.kernel import Kernel
from cwmav_sim.sph.pair import FLUID_ROWS, pack_fluid, pair_constants
from cwmav_sim.sph.patches import CHUNKS
from cwmav_sim.sph.rates import Rates, as_rates, numbered
from cwmav_sim.sph.settings import FlowSettings
from cwmav_sim.sph.sheet import Motion, Nodes, SheetLoad, SheetQuadrature
from cwmav_sim.sph.state import Particles
from cwmav_sim.sph.subgrid import add_subgrid_stress
from cwmav_sim.sph.subgrid import constants as subgrid_constants
from cwmav_sim.sph.surfaces import Sides, Surfaces, locate_surfaces
from cwmav_sim.sph.timers import Timers
from cwmav_sim.sph.wall import wall_constants

FloatArray = NDArray[np.float64]


class Interaction:
    """The sums over neighbours and walls for one set of settings.

    Parameters
    ----------
    settings : FlowSettings
        Numerics.
    grid : Grid
        Box and cells.
    eos : Tait
        Equation of state.
    motion : Motion or None
        The walls.
    timers : Timers
        Receives the time of the phases sort, walls and pairs.

    Attributes
    ----------
    quadrature : SheetQuadrature or None
        Elements of the walls.
    panels : int
        Number of walls.
    holds_air : bool
        Whether particles that pass through a wall are put back.
    """

    holds_air = True

    def __init__(
        self, settings: FlowSettings, grid: Grid, eos: Tait, motion: Motion | None, timers: Timers
    ) -> None:
        dp, fluid = settings.resolution.dp, settings.fluid
        self.dtype = np.dtype(np.float32 if settings.resolution.precision == "single" else np.float64)
        self.kernel = Kernel(settings.resolution.h_over_dp * dp, settings.box.dimensions)
        self._grid, self._eos, self._timers = grid, eos, timers
        self._keep_diffusion = fluid.diffusion_near_wall == "keep"
        self._shifting = settings.shifting.coefficient > 0.0
        self.quadrature = None if motion is None else _quadrature(settings, motion, grid)
        self._orders = lane_orders(self.dtype)
        self._gravity = np.array([0.0, 0.0, -fluid.gravity])
        self.panels = 0 if self.quadrature is None else self.quadrature.panels
        self._weights: sp.csr_matrix | None = None
        self._pair_k = pair_constants(
            self.kernel.h,
            fluid.density,
            float(self.kernel.value(dp)),
            self.kernel.amplitude,
            settings.shifting.tensile,
            self.dtype,
        )
        self._wall_k = wall_constants(
            self.kernel,
            dp,
            fluid.viscosity,
            eos.sound_speed,
            settings.sheet.approach_damping,
            fluid.density,
            fluid.diffusion if self._keep_diffusion else 0.0,
            self.dtype,
        )
        self._subgrid_k = None
        if fluid.turbulence == "sps":
            self._subgrid_k = subgrid_constants(
                self.kernel.h, self.kernel.slope, dp, fluid.density, settings.box.dimensions
            )
        # Fourtakas et al. (2019): 2 delta h c0.
        diffusion = 2.0 * fluid.diffusion * self.kernel.h * eos.sound_speed
        self._scale = np.array([self.kernel.slope, 4.0 * fluid.viscosity, diffusion, fluid.density, 0.0])

    def rates(
        self, particles: Particles, nodes: Nodes | None, *, shifting: bool, reactions: bool = False
    ) -> Rates:
        """Return the rates of the particles, which lie inside the box, among the walls in the given state.

        The concentration gradient is summed only when ``shifting`` asks for it, and the reaction of every
        wall element only when ``reactions`` does.
        """
        shifting = shifting and self._shifting
        with self._timers.phase("sort"):
            sorting = sort_into_cells(particles.x, self._grid)
            fluid = self._pack(particles, sorting)
            column = sorting.column.astype(self.dtype)
        if self.quadrature is None or nodes is None:
            with self._timers.phase("pairs"):
                return self._unbounded(particles, sorting, fluid, column, shifting)
        return self._walled(particles, nodes, sorting, fluid, column, shifting, reactions)

    def predict_walls(self, dt: float) -> None:
        """Bring whatever state the walls have to half the step of ``dt`` [s]; two-sided ones have none."""

    def correct_walls(self, dt: float) -> None:
        """Bring whatever state the walls have over the step."""

    def save(self) -> dict[str, NDArray]:
        """Return whatever state the walls have, by name; two-sided ones have none."""
        return {}

    def restore(self, saved: dict[str, NDArray]) -> None:
        """Go to a saved state."""

    def sheet_load(
        self, rates: Rates, nodes: Nodes, crossed: Crossings | None = None, dt: float = 1.0
    ) -> SheetLoad:
        """Bring the reactions of the wall elements to the nodes.

        The kicks of particles that were put back are spread over the step of ``dt`` [s].
        """
        quadrature = self.quadrature
        if quadrature is None or rates.reaction is None:
            raise ValueError("no reactions were asked for")
        if self._weights is None:
            self._weights = self._shares(len(nodes.x))
        force, carried = rates.reaction[:3].T.copy(), rates.reaction[3]
        if crossed is not None and len(crossed.panel):
            place = quadrature.nearest(quadrature.place(nodes), crossed.x, crossed.panel)
            np.add.at(force, place, crossed.kick / dt)
        back = self._weights.T
        return SheetLoad(np.asarray(back @ force), np.asarray(back @ carried))

    def _shares(self, nodes: int) -> sp.csr_matrix:
        """Share of every node in the position of every wall element, shape (elements, nodes)."""
        assert self.quadrature is not None  # noqa: S101 - for the type checker
        return self.quadrature.weights(nodes)

    def pairs(self, particles: Particles) -> int:
        """Count the ordered pairs within the support, images across the faces of the box left out."""
        tree = cKDTree(particles.x)
        return int(tree.count_neighbors(tree, 2.0 * self.kernel.h)) - particles.count

    def storage_order(self, particles: Particles) -> NDArray[np.int64]:
        """Return the order in which neighbouring particles lie next to each other."""
        return sort_into_cells(particles.x, self._grid).order

    def _pack(self, particles: Particles, sorting: Sorting) -> NDArray:
        fluid = np.empty((FLUID_ROWS, particles.count), self.dtype)
        pressure = self._eos.pressure(particles.rho)
        pack_fluid(
            sorting.local,
            particles.v,
            particles.rho,
            pressure,
            sorting.order,
            particles.mass,
            self._eos.density,
            fluid,
        )
        return fluid

    def _add_subgrid_stress(
        self,
        acceleration: FloatArray,
        particles: Particles,
        sorting: Sorting,
        fluid: NDArray,
        column: NDArray,
        sides: Sides,
        near: NDArray[np.bool_] | None = None,
    ) -> None:
        if self._subgrid_k is None:
            return
        add_subgrid_stress(
            acceleration,
            fluid,
            column,
            sorting.order,
            sorting.start,
            self._grid.integers,
            self._grid.cell.astype(self.dtype),
            particles.mass,
            self._subgrid_k,
            sides.signed,
            sides.inside,
            np.zeros(self._grid.cells, np.bool_) if near is None else near,
            self.panels,
            buffer_room(sorting.start, self._grid.integers),
            self._orders,
        )

    def _add_gravity(self, acceleration: FloatArray) -> None:
        if self._gravity.any():
            acceleration += self._gravity

    def _unbounded(
        self, particles: Particles, sorting: Sorting, fluid: NDArray, column: NDArray, shifting: bool
    ) -> Rates:
        integers = self._grid.integers
        n = particles.count
        acceleration, density_rate, shift = np.empty((n, 3)), np.empty(n), np.empty((n, 3))
        forces.fluid_pass(
            fluid,
            column,
            sorting.order,
            sorting.start,
            integers,
            self._grid.cell.astype(self.dtype),
            self._pair_k,
            self._scale,
            shifting,
            buffer_room(sorting.start, integers),
            self._orders,
            acceleration,
            density_rate,
            shift,
        )
        sides = Sides.empty(0, n, self.dtype)
        self._add_subgrid_stress(acceleration, particles, sorting, fluid, column, sides)
        self._add_gravity(acceleration)
        return as_rates(acceleration, density_rate, shift, np.zeros((0, forces.LOAD_SIZE)), sides)

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
        assert self.quadrature is not None  # noqa: S101 - for the type checker
        with self._timers.phase("walls"):
            placed = self.quadrature.place(nodes).relative_to(self._gravity)
            surfaces = locate_surfaces(self.quadrature, placed, self._grid, fluid, column, sorting.start)
        with self._timers.phase("pairs"):
            return self._bounded(particles, sorting, fluid, column, surfaces, shifting, reactions)

    def _bounded(
        self,
        particles: Particles,
        sorting: Sorting,
        fluid: NDArray,
        column: NDArray,
        surfaces: Surfaces,
        shifting: bool,
        reactions: bool,
    ) -> Rates:
        integers = self._grid.integers
        elements, sides = surfaces.elements, surfaces.particle_sides
        n = particles.count
        acceleration, density_rate, shift = np.empty((n, 3)), np.empty(n), np.empty((n, 3))
        loads = np.zeros((CHUNKS, self.panels, forces.LOAD_SIZE))
        count = elements.rows.shape[1]
        parts = np.zeros((CHUNKS, REACTION_SIZE, count)) if reactions else None
        scale = self._scale.copy()
        scale[forces.MASS] = particles.mass
        walled.walled_pass(
            fluid,
            column,
            sorting.order,
            sorting.start,
            integers,
            self._grid.cell.astype(self.dtype),
            self._pair_k,
            scale,
            shifting,
            self._keep_diffusion,
            buffer_room(sorting.start, integers),
            self._orders,
            sides.signed,
            sides.inside,
            surfaces.near,
            surfaces.near_any,
            elements.rows,
            elements.column,
            elements.start,
            buffer_room(elements.start, integers),
            surfaces.element_sides.signed,
            surfaces.element_sides.inside,
            self._wall_k,
            self._grid.low,
            acceleration,
            density_rate,
            shift,
            loads,
            parts,
        )
        self._add_subgrid_stress(acceleration, particles, sorting, fluid, column, sides, surfaces.near_any)
        self._add_gravity(acceleration)
        own = sides.in_storage_order(self.panels, sorting.order, sorting.start, surfaces.near_any)
        found = as_rates(acceleration, density_rate, shift, loads.sum(axis=0), own)
        return found if parts is None else replace(found, reaction=numbered(parts, elements.number))


def _quadrature(settings: FlowSettings, motion: Motion, grid: Grid) -> SheetQuadrature:
    dp = settings.resolution.dp
    periodic = (0, 2) if grid.mirrored or grid.dimensions == 2 else (0, 1, 2)
    faces = [
        (axis, float(at)) for axis in periodic for at in (grid.low[axis], grid.low[axis] + grid.size[axis])
    ]
    return SheetQuadrature(
        motion,
        spacing=settings.sheet.element_spacing * dp,
        probe_spacing=0.5 * dp,
        set_back=settings.sheet.set_back * dp,
        dimensions=settings.box.dimensions,
        mirrored=settings.box.symmetric,
        faces=faces,
    )
