# SPDX-License-Identifier: Apache-2.0
"""The safety net of ``cwmav_sim.sph.crossing`` on the card: no particle may pass through a wall."""

from __future__ import annotations

import numpy as np
from numba import cuda

from cwmav_common.errors import WorkError
from cwmav_sim.cuda.launch import CardArray, clear, empty, launch, zeros
from cwmav_sim.sph.crossing import BACK, JUMP, Crossings

_ROOM = 1 << 16  # events of one step that are kept; so many mean that the flow is lost


class Net:
    """Puts particles back that changed sides within a step.

    Parameters
    ----------
    count, panels : int
        Number of particles and of walls.
    dp : float
        Particle spacing [m].
    """

    def __init__(self, count: int, panels: int, dp: float) -> None:
        self._panels, self._dp = panels, dp
        self._room = min(_ROOM, max(1, count * panels))
        self._found = zeros(1, np.int32)
        self._events = empty((2, self._room), np.int32)
        self._values = empty((6, self._room))

    def put_back(
        self, x: CardArray, v: CardArray, before: CardArray, now: CardArray, mass: float, dt: float
    ) -> None:
        """Put particles back in place; what was caught can be asked for later.

        ``before`` and ``now`` are the sides at both ends of the last step of ``dt`` [s].
        """
        clear(self._found)
        back, jump = BACK * self._dp, JUMP * self._dp
        launch(
            _put_back,
            x.shape[1],
            x,
            v,
            before,
            now,
            back,
            jump,
            mass,
            dt,
            self._found,
            self._events,
            self._values,
        )

    def caught(self, x: CardArray, dt: float) -> Crossings:
        """Wait for the card and return what was caught, in the order of panels and numbers.

        Raises
        ------
        WorkError
            When more particles crossed than are kept track of.
        """
        found = int(self._found.copy_to_host()[0])
        if found == 0:
            return Crossings.none(self._panels)
        if found > self._room:
            raise WorkError(f"{found} particles passed through the walls within one step of {dt:.3g} s")
        launch(_places, found, found, self._events, x, self._values)
        events = self._events.copy_to_host()[:, :found]
        by_number = np.lexsort((events[1], events[0]))
        panel = events[0, by_number].astype(np.int64)
        values = self._values.copy_to_host()[:, by_number]
        kick = np.ascontiguousarray(values[3:].T)
        impulse = np.zeros((self._panels, 3))
        np.add.at(impulse, panel, kick)
        count = np.bincount(panel, minlength=self._panels)
        return Crossings(count, impulse, panel, np.ascontiguousarray(values[:3].T), kick)


@cuda.jit(cache=True)
def _put_back(x, v, before, now, back, jump, mass, dt, found, events, values):
    i = cuda.grid(1)
    if i >= x.shape[1]:
        return
    for panel in range(now.shape[0]):
        s0, s1 = before[panel, 0, i], now[panel, 0, i]
        if s0 * s1 >= 0.0 or abs(s1 - s0) > jump:
            continue
        if before[panel, 1, i] * abs(s1) + now[panel, 1, i] * abs(s0) <= 0.0:
            continue
        side = 1.0 if s0 > 0.0 else -1.0
        speed = (s1 - s0) / dt
        at = cuda.atomic.add(found, 0, 1)
        if at < events.shape[1]:
            events[0, at] = panel
            events[1, at] = i
        for q in range(3):
            n = now[panel, 2 + q, i]
            x[q, i] += (side * back - s1) * n
            v[q, i] -= speed * n
            if at < events.shape[1]:
                values[3 + q, at] = mass * speed * n


@cuda.jit(cache=True)
def _places(found, events, x, values):
    k = cuda.grid(1)
    if k < found:
        for q in range(3):
            values[q, k] = x[q, events[1, k]]
