# SPDX-License-Identifier: Apache-2.0
"""The seam between air and structure: loads in, motion of the sheet out, with an energy account.

The air solver asks a moving sheet for its nodes; a flexible wing must first be told the loads. How the two go
together is in :mod:`cwmav_sim.coupling`.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cwmav_common.errors import InputError, WorkError
from cwmav_sim.wing.arithmetic import Arithmetic
from cwmav_sim.wing.carried import Carried
from cwmav_sim.wing.contact import ContactLaw, Impacts
from cwmav_sim.wing.dynamics import Load, System
from cwmav_sim.wing.integrate import Integration, Integrator
from cwmav_sim.wing.load_loops import at_end, onward, scaled
from cwmav_sim.wing.motion import Counters, Energies, Motion
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.sheet import FloatArray, IntArray, SheetState
from cwmav_sim.wing.sheet_map import ImpactMap, PortableMap, SheetMap


class WingStructure(Protocol):
    """A structure that moves under nodal loads and a driven root.

    Attributes
    ----------
    triangles, panel, panel_names
        As in :class:`cwmav_sim.wing.sheet.SheetMotion`; they never change.
    time : float
        Time reached [s].
    energies : Energies
        Kinetic and elastic energy, dissipation and work since the start [J].
    """

    @property
    def triangles(self) -> IntArray:
        """Node numbers of each triangle, shape (m, 3)."""
        ...

    @property
    def panel(self) -> IntArray:
        """Panel number of each triangle, shape (m,)."""
        ...

    @property
    def panel_names(self) -> tuple[str, ...]:
        """Names of the panels."""
        ...

    @property
    def time(self) -> float:
        """Time reached [s]."""
        ...

    @property
    def energies(self) -> Energies:
        """Energy account since the start [J]."""
        ...

    def advance(self, time: float, load: FloatArray) -> SheetState:
        """Go on to ``time`` [s]; ``load`` (n, 3) [N] acts on the sheet's nodes at the end of the interval."""
        ...

    def state(self) -> SheetState:
        """Return the sheet at the time reached."""
        ...

    def save(self) -> Motion:
        """Return everything needed to go on from here."""
        ...

    def restore(self, motion: Motion) -> None:
        """Go back to a saved instant."""
        ...


class FlexibleWings:
    """A :class:`System` behind the protocol :class:`WingStructure`.

    Parameters
    ----------
    system : System
        Equations of motion.
    sheet : SheetMap
        Sheet nodes of the unknowns.
    triangles, panel : ndarray
        Topology of the sheet.
    panel_names : tuple of str
        Names of the panels.
    integration : Integration
        Settings of the time integration.
    x, turn : ndarray
        Unloaded shape at ``time``, from which the wings start at rest.
    contact : ContactLaw
        Contact between the wings of a pair.
    time : float
        Start time [s].
    """

    def __init__(
        self,
        system: System,
        sheet: SheetMap,
        triangles: IntArray,
        panel: IntArray,
        panel_names: tuple[str, ...],
        integration: Integration,
        x: FloatArray,
        turn: FloatArray,
        *,
        contact: ContactLaw | None = None,
        time: float = 0.0,
    ) -> None:
        self.system, self.sheet = system, sheet
        self._triangles, self._panel, self._names = triangles, panel, panel_names
        self._integrator = Integrator(system, integration, x, turn, time=time)
        self._count = int(triangles.max()) + 1
        self.impacts: Impacts | None = None
        if contact is not None and contact.enabled:
            if not isinstance(sheet, ImpactMap):
                raise TypeError(f"{type(sheet).__name__} cannot take impacts, which contact needs")
            self.impacts = Impacts(contact, system, sheet, triangles, panel, panel_names, self.state().x)

    @property
    def portable(self) -> bool:
        """Whether the structure can be brought to another place."""
        return self.system.portable and isinstance(self.sheet, PortableMap)

    def bring(self, arithmetic: Arithmetic) -> None:
        """Go on with all arrays in the place of an arithmetic; loads are taken and states returned there.

        What contacts do to each other is still found on the host.

        Raises
        ------
        TypeError
            The sheet, or an element of the structure, knows only the host.
        """
        if not isinstance(self.sheet, PortableMap):
            raise TypeError(f"a sheet of type {type(self.sheet).__name__} is computed on the host only")
        self.system = self.system.brought(arithmetic)
        self.sheet = self.sheet.brought(self.system)
        self._integrator.bring(self.system)
        if self.impacts is not None:
            self.impacts.bring(arithmetic, self.sheet)

    @property
    def triangles(self) -> IntArray:
        """Node numbers of each triangle, shape (m, 3)."""
        return self._triangles

    @property
    def panel(self) -> IntArray:
        """Panel number of each triangle, shape (m,)."""
        return self._panel

    @property
    def panel_names(self) -> tuple[str, ...]:
        """Names of the panels."""
        return self._names

    @property
    def time(self) -> float:
        """Time reached [s]."""
        return self._integrator.motion.time

    @property
    def energies(self) -> Energies:
        """Energy account since the start [J]."""
        return self._integrator.motion.energies

    @property
    def counters(self) -> Counters:
        """Steps, Newton iterations and factorisations so far."""
        return self._integrator.counters

    def advance(self, time: float, load: FloatArray) -> SheetState:
        """Go on to ``time`` [s] under the nodal ``load`` (n, 3) [N]; loads grow linearly from the last ones.

        Raises
        ------
        InputError
            The time lies before the time reached, or the loads have the wrong shape or are not finite.
        WorkError
            The step does not converge.
        """
        self._check(time, load)
        if time > self.time:
            self._integrator.advance(time, lambda c: self.sheet.load(c, load))
            self._collide()
        return self.state()

    def pushed(self, time: float, load: FloatArray, carried: Carried) -> SheetState:
        """Go on to ``time`` [s] under a nodal load (n, 3) [N] that is the mean over the step.

        ``carried`` air answers to accelerations other than those with which the load was computed. See
        :meth:`advance` for the errors.
        """
        self._check(time, load)
        if time > self.time:
            self._integrator.advance(time, self._mean(time, load, carried))
            self._collide()
        return self.state()

    def foreseen(self, time: float, load: FloatArray, carried: Carried) -> tuple[Configuration, SheetState]:
        """Return where :meth:`pushed` would lead, contacts apart, without going there."""
        self._check(time, load)
        begin = self._integrator.motion
        try:
            reached = self._integrator.advance(time, self._mean(time, load, carried), accounted=False)
        finally:
            self._integrator.amend(begin)
        return reached.configuration, self.sheet.state(reached.configuration, reached.acceleration)

    def state(self) -> SheetState:
        """Return the sheet at the time reached."""
        motion = self._integrator.motion
        return self.sheet.state(motion.configuration, motion.acceleration)

    @property
    def configuration(self) -> Configuration:
        """Where everything is at the time reached, in the place of the structure's arrays."""
        return self._integrator.motion.configuration

    def save(self) -> Motion:
        """Return everything needed to go on from here, on the host."""
        return self._integrator.motion.moved(self.system.arithmetic.on_host)

    def restore(self, motion: Motion) -> None:
        """Go back to a saved instant."""
        self._integrator.restore(motion.moved(self.system.arithmetic.brought))
        if self.impacts is not None:
            self.impacts.forget()

    def _collide(self) -> None:
        if self.impacts is not None:
            self._integrator.amend(self.impacts.resolve(self._integrator.motion))

    def _mean(self, time: float, load: FloatArray, carried: Carried) -> Load:
        """Load at the end of the step whose average with that at its begin is the given one.

        The method feels (1 - f) times the load at the end and f times that at the begin, nothing else.
        """
        air, begin, f = self.system.carried, self._integrator.motion, self._integrator.share_of_begin
        step, c0, arithmetic = time - begin.time, begin.configuration, self.system.arithmetic
        if air is None:
            raise ValueError("this structure was built without room for carried air")
        blocks = self.sheet.carried(c0, carried.mass, carried.normal)
        entries, rows = arithmetic.flat(blocks), self.system.rows
        arithmetic.run(scaled, len(entries), 1.0 / (step * (1.0 - f)), entries, entries)
        foreseen = arithmetic.empty(rows, 3)
        arithmetic.run(onward, rows, step, c0, carried.rate, foreseen)
        air.renew(blocks, foreseen)

        def end(c: Configuration) -> FloatArray:
            out = arithmetic.empty(rows, 3)
            arithmetic.run(at_end, rows, f, begin.force, self.sheet.load(c, load), out)
            air.change(c, out)
            return out

        return end

    def _check(self, time: float, load: FloatArray) -> None:
        if not time >= self.time:
            raise InputError(
                f"wing structure: time {time:g} s lies before the time reached; allowed: >= {self.time:g} s"
            )
        if load.shape != (self._count, 3):
            raise InputError(f"wing structure: loads have shape {load.shape}; allowed: ({self._count}, 3)")
        if not np.isfinite(self.system.arithmetic.largest(load)[0]):
            raise WorkError("wing structure: the air load is not finite")
