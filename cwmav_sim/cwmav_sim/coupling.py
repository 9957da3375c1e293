# SPDX-License-Identifier: Apache-2.0
"""Flexible wings in the air: the order in which air and structure move.

One step of the air, from t to t + dt, goes

1. The air's rates at t give the force on every wall element. Nodes receive it by the transpose of what places
   the elements, so force, moment and power are the same on both sides.
2. The structure tries the step under that load, which foresees its mean acceleration a, and goes back. The
   sheet at t + dt/2 is then x + v dt/2 + a dt^2/8 with the velocity v + a dt/2.
3. The air's rates there give the load of the step: what the air loses in the corrector, the wings gain.
4. The structure goes from t to t + dt under that load as its mean over the step. The part of the load that
   follows from acceleration, the air the wing carries along, is taken with the true acceleration instead of
   the foreseen one (:mod:`cwmav_sim.wing.carried`); this keeps wings stable that are lighter than that air.
   By how much the foreseen acceleration was missed is made good to the air in step 3 of the next step.

Momentum is thus exchanged exactly, but for the correction of the last step. What the exchange gains or loses
in energy is the sum of two works, of the load on the structure and of the walls on the air; the balance of a
run reports it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from cwmav_common.errors import WorkError
from cwmav_common.settings import setting
from cwmav_sim.sph.sheet import SheetLoad
from cwmav_sim.wing.arithmetic import HOST, Arithmetic, Loop
from cwmav_sim.wing.carried import Carried
from cwmav_sim.wing.coupling_loops import (
    differences,
    foreseen_nodes,
    node_normals,
    rate_changes,
    sums,
)
from cwmav_sim.wing.load_loops import scaled
from cwmav_sim.wing.motion import FIELDS, Energies, Motion
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.sheet import FloatArray, IntArray, SheetState
from cwmav_sim.wing.sparsity import gathering
from cwmav_sim.wing.structure import FlexibleWings


@dataclass(frozen=True)
class Coupling:
    """Exchange between flexible wings and air."""

    carried_air: float = setting(
        1.0, "share of the carried air that is taken implicitly; light wings need at least 0.5", ge=0, le=3
    )
    substeps: int = setting(1, "steps of the structure within one of the air", ge=1, le=1000)


@dataclass(frozen=True)
class _Acceleration:
    """Mean accelerations over a step: of the structure's unknowns (rows, 3) and of the sheet (n, 3)."""

    unknowns: FloatArray
    sheet: FloatArray

    def moved(self, bring: Callable[[FloatArray], FloatArray]) -> _Acceleration:
        """Return the same in another place."""
        return _Acceleration(bring(self.unknowns), bring(self.sheet))


class Normals:
    """Area-weighted normals of the nodes of a sheet.

    Parameters
    ----------
    triangles : ndarray, shape (m, 3)
        Node numbers.
    arithmetic : Arithmetic
        Where they are computed.
    """

    def __init__(self, triangles: IntArray, arithmetic: Arithmetic = HOST) -> None:
        self._arithmetic, self._count = arithmetic, int(triangles.max()) + 1
        lists = (triangles, *gathering(triangles.ravel(), self._count))
        self._lists = [arithmetic.brought(values) for values in lists]

    def of(self, x: FloatArray) -> FloatArray:
        """Return the unit normals of nodes at ``x`` (n, 3), shape (n, 3).

        Raises
        ------
        WorkError
            A wing has folded up so that a normal vanishes.
        """
        arithmetic, n = self._arithmetic, self._count
        normal, inverse = arithmetic.empty(n, 3), arithmetic.empty(n)
        arithmetic.run(node_normals, n, x, *self._lists, normal, inverse)
        if not np.isfinite(arithmetic.largest(inverse)[0]):
            raise WorkError("wing structure: a wing has folded up; its normal vanishes")
        return normal


class CoupledWings:
    """Flexible wings as the air's solver sees them: it asks for their nodes and tells them their loads.

    Parameters
    ----------
    structure : FlexibleWings
        The wings at the start of the run.
    coupling : Coupling
        How they exchange with the air.
    period : float
        Flapping period [s].
    """

    def __init__(self, structure: FlexibleWings, coupling: Coupling, period: float) -> None:
        self.structure, self.coupling, self.period = structure, coupling, period
        self._arithmetic: Arithmetic = HOST
        self._normals = Normals(structure.triangles)
        self._now = structure.state()
        rest = _Acceleration(np.zeros((structure.system.rows, 3)), np.zeros_like(self._now.x))
        self._foreseen = self._owed = self._shown = rest

    @property
    def portable(self) -> bool:
        """Whether the wings can be computed in another place."""
        return self.structure.portable

    def bring(self, arithmetic: Arithmetic) -> None:
        """Go on in the place of an arithmetic: loads are taken from there, and :meth:`nodes` lie there.

        Raises
        ------
        TypeError
            The structure knows only the host.
        """
        self.structure.bring(arithmetic)
        self._arithmetic = arithmetic
        self._normals = Normals(self.structure.triangles, arithmetic)
        self._now = self.structure.state()
        self._foreseen, self._owed, self._shown = (
            value.moved(arithmetic.brought) for value in (self._foreseen, self._owed, self._shown)
        )

    @property
    def triangles(self) -> IntArray:
        """Node numbers of each triangle, shape (m, 3)."""
        return self.structure.triangles

    @property
    def panel(self) -> IntArray:
        """Panel number of each triangle, shape (m,)."""
        return self.structure.panel

    @property
    def panel_names(self) -> tuple[str, ...]:
        """Names of the panels."""
        return self.structure.panel_names

    @property
    def energies(self) -> Energies:
        """Energy account of the structure since the start [J]."""
        return self.structure.energies

    def state(self, t: float) -> SheetState:
        """Return the nodes at the time reached, or foresee them at ``t`` [s] soon after it; on the host.

        Raises
        ------
        ValueError
            ``t`` lies before the time reached.
        """
        nodes, on_host = self.nodes(t), self._arithmetic.on_host
        return SheetState(on_host(nodes.x), on_host(nodes.v), on_host(nodes.a))

    def nodes(self, t: float) -> SheetState:
        """Return what :meth:`state` returns, in the place where the structure is computed."""
        s = t - self.structure.time
        if s < 0.0:
            raise ValueError(f"the wings have reached {self.structure.time:g} s; {t:g} s is past")
        now, arithmetic, n = self._now, self._arithmetic, len(self._now.x)
        x, v = arithmetic.empty(n, 3), arithmetic.empty(n, 3)
        arithmetic.run(foreseen_nodes, n, s, now.x, now.v, self._foreseen.sheet, x, v)
        return SheetState(x, v, self._shown.sheet)

    def foresee(self, t: float, load: SheetLoad) -> None:
        """Try the step to ``t`` [s] under a load; until it is made, :meth:`state` foresees by its outcome."""
        structure = self.structure
        outcome = structure.foreseen(t, load.force, self._carried(load))
        now = (structure.configuration, self._now)
        self._foreseen = self._mean(now, outcome, t - structure.time)
        self._shown = self._combined(sums, self._foreseen, self._owed)

    def accept(self, t: float, load: SheetLoad) -> None:
        """Go on to time ``t`` [s] under the load of the step of the air that ends there.

        Raises
        ------
        WorkError
            The load is not finite, or the structure finds no equilibrium.
        """
        structure, began, count = self.structure, self.structure.time, self.coupling.substeps
        carried, before = self._carried(load), (structure.configuration, self._now)
        state = self._now
        for k in range(1, count + 1):
            target = t if k == count else began + (t - began) * k / count
            state = structure.pushed(target, load.force, carried)
        done = self._mean(before, (structure.configuration, state), t - began)
        self._owed = self._combined(differences, done, self._foreseen)
        self._now, self._foreseen, self._shown = state, done, done

    def _carried(self, load: SheetLoad) -> Carried:
        """Return what the air was shown when it computed a load."""
        mass = self._arithmetic.empty(len(load.carried))
        self._arithmetic.run(scaled, len(mass), self.coupling.carried_air, load.carried, mass)
        return Carried(mass, self._normals.of(self._now.x), self._shown.unknowns)

    def _mean(
        self,
        begin: tuple[Configuration, SheetState],
        end: tuple[Configuration, SheetState],
        step: float,
    ) -> _Acceleration:
        """Mean accelerations between two instants ``step`` [s] apart."""
        arithmetic, rows = self._arithmetic, self.structure.system.rows
        unknowns = arithmetic.empty(rows, 3)
        arithmetic.run(rate_changes, rows, step, begin[0], end[0], unknowns)
        return _Acceleration(unknowns, self._by_number(differences, 1.0 / step, end[1].v, begin[1].v))

    def _combined(self, loop: Loop, one: _Acceleration, other: _Acceleration) -> _Acceleration:
        """Sum or difference of two accelerations."""
        return _Acceleration(
            self._by_number(loop, 1.0, one.unknowns, other.unknowns),
            self._by_number(loop, 1.0, one.sheet, other.sheet),
        )

    def _by_number(self, loop: Loop, share: float, one: FloatArray, other: FloatArray) -> FloatArray:
        flat, out = self._arithmetic.flat, self._arithmetic.empty(*one.shape)
        numbers = flat(out)
        self._arithmetic.run(loop, len(numbers), share, flat(one), flat(other), numbers)
        return out

    def settle(self) -> None:
        """Forget what only speeds the work up, so that a run continued from here repeats bit for bit."""
        self.structure.restore(self.structure.save())

    def save(self) -> dict[str, FloatArray]:
        """Return everything needed to go on from here, as arrays by name."""
        motion, on_host = self.structure.save(), self._arithmetic.on_host
        out = {name: getattr(motion, name) for name in FIELDS}
        for name, values in motion.configuration._asdict().items():
            out[f"configuration.{name}"] = values
        out["time"] = np.array(motion.time)
        out["energies"] = np.array([getattr(motion.energies, f.name) for f in fields(Energies)])
        for name, value in (("done", self._foreseen), ("owed", self._owed)):
            out[f"{name}.unknowns"], out[f"{name}.sheet"] = on_host(value.unknowns), on_host(value.sheet)
        return out

    def restore(self, saved: dict[str, FloatArray]) -> None:
        """Go to a saved instant."""
        parts: dict[str, Any] = {name: saved[name] for name in FIELDS}
        configuration = {name: saved[f"configuration.{name}"] for name in Configuration._fields}
        self.structure.restore(
            Motion(
                time=float(saved["time"]),
                configuration=Configuration(**configuration),
                energies=Energies(*(float(e) for e in saved["energies"])),
                **parts,
            )
        )
        self._now = self.structure.state()
        done, self._owed = (
            _Acceleration(saved[f"{name}.unknowns"], saved[f"{name}.sheet"]).moved(self._arithmetic.brought)
            for name in ("done", "owed")
        )
        self._foreseen = self._shown = done
