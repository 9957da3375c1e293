# SPDX-License-Identifier: Apache-2.0
"""Rates of change of all particles, found on the card; what ``cwmav_sim.sph.interaction`` does there."""

from __future__ import annotations

from typing import Any

import numpy as np

from cwmav_common.errors import InputError
from cwmav_sim.cuda.cells import CardGrid, CellSort, find_cells, floats
from cwmav_sim.cuda.elements import CardElements
from cwmav_sim.cuda.fluid import near_pass, open_pass, pack
from cwmav_sim.cuda.launch import CardArray, empty, launch, start_blocks, zeros
from cwmav_sim.cuda.nearness import OWN_ROWS, Nearness
from cwmav_sim.cuda.reactions import reaction_pass
from cwmav_sim.cuda.scan import reduce_blocks
from cwmav_sim.cuda.state import CardParticles
from cwmav_sim.cuda.vector import MOVE_SIZE, PLACE_SIZE, STATE_SIZE
from cwmav_sim.cuda.walled import WALL_BLOCKS, wall_pass
from cwmav_sim.sph.around import REACTION_SIZE
from cwmav_sim.sph.cells import Grid
from cwmav_sim.sph.eos import Tait
from cwmav_sim.sph.forces import LOAD_SIZE
from cwmav_sim.sph.interaction import Interaction
from cwmav_sim.sph.settings import FlowSettings
from cwmav_sim.sph.sheet import Motion, Nodes, SheetLoad
from cwmav_sim.sph.timers import Timers


class CardInteraction:
    """The sums over neighbours and walls for one set of settings.

    Constants and the wall quadrature are those of the interaction on the processor, so both devices solve
    the same equations by construction.

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
    count : int
        Number of particles.
    mass : float
        Mass of a particle [kg].

    Attributes
    ----------
    acceleration, density_rate, shift : array, shape (3, n), (n,) and (3, n)
        Rates that the last pass found, under the numbers of the particles.
    reaction : array, shape (4, elements)
        Force on every element [N] and air carried along [kg], where asked for.
    """

    def __init__(
        self, settings: FlowSettings, grid: Grid, eos: Tait, motion: Motion | None, count: int, mass: float
    ) -> None:
        refuse_unknown(settings, motion)
        host = Interaction(settings, grid, eos, motion, Timers())
        self.host = host
        self.panels, dtype = host.panels, host.dtype
        self._mass, self._gravity = mass, -settings.fluid.gravity
        self._shifting, self._keep = host._shifting, host._keep_diffusion
        self._grid = CardGrid.of(grid, host.kernel.h, dtype)
        self._pair_k: tuple[Any, ...] = tuple(host._pair_k)
        self._wall_k: tuple[Any, ...] = tuple(host._wall_k)
        self._scale = (*floats(host._scale[:4]), mass)
        self._eos = (eos.density, eos.stiffness, eos.gamma, eos.background)
        self._sort = CellSort(count, grid.cells)
        self._records = tuple(empty((count, size), dtype) for size in (PLACE_SIZE, MOVE_SIZE, STATE_SIZE))
        self._cell_of = empty(count, np.int32)
        self.acceleration, self.density_rate = empty((3, count)), empty(count)
        self.shift = zeros((3, count))
        self._walls: CardElements | None = None
        elements = 0
        if motion is not None and host.quadrature is not None:
            self._walls = CardElements(host.quadrature, motion, self._grid, settings.fluid.gravity, dtype)
            elements = self._walls.count
        self._nearness = Nearness(count, elements, self.panels, self._grid, dtype)
        self.reaction = empty((REACTION_SIZE, max(elements, 1)))
        self._partial = empty((self.panels * LOAD_SIZE, WALL_BLOCKS))
        self._count = count

    def sides(self) -> CardArray:
        """Return room for the sides of all particles, shape (panels, 5, n), all of them far away."""
        return zeros((self.panels, OWN_ROWS, self._count), self.host.dtype)

    def storage_order(self, particles: CardParticles) -> CardArray:
        """Return the order in which neighbouring particles lie next to each other, shape (n,)."""
        find_cells(particles.x, self._grid, self._sort.key)
        self._sort.sort()
        return self._sort.order

    def rates(
        self,
        particles: CardParticles,
        nodes: Nodes | None,
        own: CardArray,
        *,
        shifting: bool,
        reactions: bool = False,
    ) -> None:
        """Find the rates of the particles, which lie inside the box, among the walls in the given state.

        ``own`` receives the sides of the particles. The shifting vector is summed only when ``shifting`` asks
        for it, and the reactions of the elements only when ``reactions`` does.
        """
        grid, sort, near = self._grid, self._sort, self._nearness
        count, shifting = self._count, shifting and self._shifting
        self.storage_order(particles)
        launch(
            pack,
            count,
            particles.x,
            particles.v,
            particles.rho,
            sort.key,
            sort.order,
            grid.low,
            grid.cell,
            grid.integers,
            self._eos,
            self._mass,
            *self._records,
            self._cell_of,
        )
        walls = self._walls if nodes is not None else None
        if walls is not None and nodes is not None:
            walls.place(nodes)
            near.find(self._records[0], self._cell_of, sort, walls, own)
        fluid_arguments = (
            *self._records,
            self._cell_of,
            sort.start,
            sort.order,
            near.before,
            near.listed,
            near.signed,
            near.inside,
            self.panels,
            grid.integers,
            grid.reach,
            self._pair_k,
            self._scale,
            self._gravity,
            shifting,
            self._keep,
            self.acceleration,
            self.density_rate,
            self.shift,
        )
        launch(open_pass, count, *fluid_arguments)
        if walls is None:
            return
        launch(near_pass, count, *fluid_arguments)
        start_blocks(
            wall_pass,
            WALL_BLOCKS,
            *self._records,
            self._cell_of,
            sort.order,
            near.before,
            near.listed,
            near.signed,
            near.inside,
            walls.rows,
            walls.column,
            walls.sort.start,
            grid.cells,
            near.element_signed,
            near.element_inside,
            self.panels,
            grid.low,
            grid.cell,
            grid.integers,
            grid.reach,
            self._wall_k,
            self._scale,
            shifting,
            self.acceleration,
            self.density_rate,
            self.shift,
            self._partial,
        )
        if reactions:
            self._react(walls)

    def node_load(self, load: SheetLoad) -> None:
        """Bring the reactions of the last pass to the nodes of a load on the card."""
        if self._walls is None:
            raise ValueError("there are no walls")
        self._walls.node_load(self.reaction, load)

    def sum_loads(self, out: CardArray, at: int) -> None:
        """Bring the wall loads of the last pass, 11 a panel, to ``out`` from place ``at`` on."""
        if self.panels:
            reduce_blocks(self._partial, 0, out, at)

    def _react(self, walls: CardElements) -> None:
        near = self._nearness
        launch(
            reaction_pass,
            walls.count,
            walls.rows,
            walls.column,
            walls.cell_of,
            walls.panel,
            walls.sort.order,
            *self._records,
            self._sort.start,
            near.signed,
            near.inside,
            near.element_signed,
            near.element_inside,
            self.panels,
            self._grid.integers,
            self._grid.reach,
            self._wall_k,
            self._mass,
            self.reaction,
        )


def refuse_unknown(settings: FlowSettings, motion: Motion | None) -> None:
    """Refuse what the card cannot compute.

    Raises
    ------
    InputError
        Names the setting and what is allowed.
    """
    if motion is not None and settings.sheet.treatment != "two-sided":
        raise InputError(
            f"flow.sheet.treatment = {settings.sheet.treatment} is computed on the CPU only; "
            "allowed with device 'cuda': two-sided"
        )
    if settings.fluid.turbulence != "none":
        raise InputError(
            f"flow.fluid.turbulence = {settings.fluid.turbulence} is computed on the CPU only; "
            "allowed with device 'cuda': none"
        )
