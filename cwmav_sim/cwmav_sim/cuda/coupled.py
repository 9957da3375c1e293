# SPDX-License-Identifier: Apache-2.0
"""Walls that the air moves, as the card's solver sees them: computed on the card, or on the host."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np

from cwmav_sim.cuda.interaction import CardInteraction
from cwmav_sim.cuda.structure import CardArithmetic
from cwmav_sim.sph.crossing import Crossings
from cwmav_sim.sph.forces import LOAD_SIZE
from cwmav_sim.sph.rates import as_rates
from cwmav_sim.sph.sheet import Compliant, Motion, Nodes, SheetLoad
from cwmav_sim.sph.surfaces import Sides
from cwmav_sim.wing.arithmetic import Arithmetic
from cwmav_sim.wing.load_loops import squares
from cwmav_sim.wing.sheet import SheetState


@runtime_checkable
class Movable(Motion, Compliant, Protocol):
    """Sheets that the air moves, whose structure may be brought to the card."""

    @property
    def portable(self) -> bool:
        """Whether all of it can."""
        ...

    def bring(self, arithmetic: Arithmetic) -> None:
        """Go on in the place of an arithmetic: loads are taken from there, and :meth:`nodes` lie there."""
        ...

    def nodes(self, t: float) -> Nodes:
        """Return the nodes at time ``t`` [s] in that place."""
        ...


class Walls:
    """Walls whose motion the host knows: prescribed ones, or sheets that it computes itself.

    Parameters
    ----------
    motion : Motion
        The walls.
    interaction : CardInteraction
        What knows the reactions of their elements.
    """

    def __init__(self, motion: Motion, interaction: CardInteraction) -> None:
        self._motion, self._interaction = motion, interaction
        self._moved: Compliant | None = motion if isinstance(motion, Compliant) else None

    @property
    def compliant(self) -> bool:
        """Whether the air moves them."""
        return self._moved is not None

    def nodes(self, t: float) -> Nodes:
        """Return the nodes at time ``t`` [s]."""
        return self._motion.state(t)

    def fastest(self, nodes: Nodes) -> float:
        """Return the largest speed of nodes [m/s]."""
        return math.sqrt(float(np.max(np.einsum("ij,ij->i", nodes.v, nodes.v))))

    def foresee(self, t: float, nodes: Nodes) -> None:
        """Foresee the motion until ``t`` [s] from the reactions at the begin of the step, at ``nodes``."""
        if self._moved is not None:
            self._moved.foresee(t, self._load(nodes, None, 1.0))

    def accept(self, t: float, nodes: Nodes, crossed: Crossings, dt: float) -> None:
        """Go on to ``t`` [s] under the reactions of the step of ``dt`` [s], taken at ``nodes``."""
        if self._moved is not None:
            self._moved.accept(t, self._load(nodes, crossed, dt))

    def _load(self, nodes: Nodes, crossed: Crossings | None, dt: float) -> SheetLoad:
        host = self._interaction.host
        nothing, sides = np.zeros((0, 3)), Sides.empty(0, 0, host.dtype)
        rates = as_rates(nothing, np.zeros(0), nothing, np.zeros((0, LOAD_SIZE)), sides)
        rates = replace(rates, reaction=self._interaction.reaction.copy_to_host())
        return host.sheet_load(rates, nodes, crossed, dt)


class CardWings(Walls):
    """Flexible wings computed on the card; see :class:`Walls` for the parameters."""

    def __init__(self, motion: Movable, interaction: CardInteraction) -> None:
        super().__init__(motion, interaction)
        self._wings, self._card = motion, CardArithmetic()
        motion.bring(self._card)

    def nodes(self, t: float) -> Nodes:
        """Return the nodes at time ``t`` [s] on the card."""
        return self._wings.nodes(t)

    def fastest(self, nodes: Nodes) -> float:
        """Return the largest speed of nodes on the card [m/s]."""
        found = self._card.empty(len(nodes.v))
        self._card.run(squares, len(nodes.v), nodes.v, found)
        return math.sqrt(self._card.largest(found)[0])

    def _load(self, nodes: Nodes, crossed: Crossings | None, dt: float) -> SheetLoad:
        if crossed is not None and len(crossed.panel):  # seldom: the host finds the elements that are hit
            there = SheetState(*(self._card.on_host(q) for q in (nodes.x, nodes.v, nodes.a)))
            load = super()._load(there, crossed, dt)
            return SheetLoad(self._card.brought(load.force), self._card.brought(load.carried))
        count = len(nodes.x)
        load = SheetLoad(self._card.empty(count, 3), self._card.empty(count))
        self._interaction.node_load(load)
        return load


def walls_of(motion: Motion | None, interaction: CardInteraction) -> Walls | None:
    """Return the walls of a motion, on the card where their structure can be brought there."""
    if motion is None:
        return None
    if isinstance(motion, Movable) and motion.portable:
        return CardWings(motion, interaction)
    return Walls(motion, interaction)
