# SPDX-License-Identifier: Apache-2.0
"""What holds a structure: driven nodes and bodies, and the frames that carry the wings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from cwmav_sim.wing.sheet import FloatArray, IntArray


class Driven(NamedTuple):
    """Prescribed motion of the driven nodes and bodies at one instant."""

    x: FloatArray
    v: FloatArray
    a: FloatArray
    turn: FloatArray
    spin: FloatArray
    spin_rate: FloatArray


@dataclass(frozen=True)
class Carrier:
    """Frames that carry the wings: orientation (g, 3, 3) and angular velocity (g, 3) about the origin."""

    axes: FloatArray
    spin: FloatArray


class Drive(Protocol):
    """What holds a structure: numbers of driven nodes and bodies, the law of their motion, the carrier.

    ``group`` (n + k,) names the carrier frame that each row of the vector field travels with. All arrays are
    on the host.
    """

    nodes: IntArray
    bodies: IntArray
    group: IntArray

    def at(self, t: float) -> Driven:
        """Return the prescribed motion at ``t`` [s]."""
        ...

    def carrier(self, t: float) -> Carrier:
        """Return the carrier frames at ``t`` [s]."""
        ...


class StillRoot:
    """A drive that holds nodes and bodies where they are."""

    def __init__(self, x: FloatArray, turn_: FloatArray, nodes: IntArray, bodies: IntArray) -> None:
        self.nodes = np.asarray(nodes, dtype=np.int64)
        self.bodies = np.asarray(bodies, dtype=np.int64)
        self.group = np.zeros(len(x) + len(turn_), dtype=np.int64)
        still = np.zeros((len(self.nodes), 3))
        steady = np.zeros((len(self.bodies), 3))
        self._driven = Driven(x[self.nodes], still, still, turn_[self.bodies], steady, steady)
        self._carrier = Carrier(np.eye(3)[None], np.zeros((1, 3)))

    def at(self, t: float) -> Driven:
        """Return the same rest at every time."""
        return self._driven

    def carrier(self, t: float) -> Carrier:
        """Return one frame at rest."""
        return self._carrier
