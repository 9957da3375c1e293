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

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from cwmav_common.errors import WorkError
from cwmav_common.settings import setting
from cwmav_sim.sph.sheet import SheetLoad
from cwmav_sim.wing.algebra import across, compiled, minus, put_sum, row
from cwmav_sim.wing.carried import Carried
from cwmav_sim.wing.dynamics import Configuration
from cwmav_sim.wing.motion import Energies, Motion
from cwmav_sim.wing.sheet import FloatArray, IntArray, SheetState
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

    def __add__(self, other: _Acceleration) -> _Acceleration:
        return _Acceleration(self.unknowns + other.unknowns, self.sheet + other.sheet)

    def __sub__(self, other: _Acceleration) -> _Acceleration:
        return _Acceleration(self.unknowns - other.unknowns, self.sheet - other.sheet)


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
        self._now = structure.state()
        self._rest = _Acceleration(np.zeros((structure.system.rows, 3)), np.zeros_like(self._now.x))
        self._foreseen = self._owed = self._shown = self._rest

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
        """Return the nodes at the time reached, or foresee them at ``t`` [s] soon after it.

        Raises
        ------
        ValueError
            ``t`` lies before the time reached.
        """
        s = t - self.structure.time
        if s < 0.0:
            raise ValueError(f"the wings have reached {self.structure.time:g} s; {t:g} s is past")
        now, a = self._now, self._foreseen.sheet
        return SheetState(now.x + s * now.v + 0.5 * s * s * a, now.v + s * a, self._shown.sheet)

    def foresee(self, t: float, load: SheetLoad) -> None:
        """Try the step to ``t`` [s] under a load; until it is made, :meth:`state` foresees by its outcome."""
        structure = self.structure
        outcome = structure.foreseen(t, load.force, self._carried(load))
        now = (structure.save().configuration, self._now)
        self._foreseen = _mean(now, outcome, t - structure.time)
        self._shown = self._foreseen + self._owed

    def accept(self, t: float, load: SheetLoad) -> None:
        """Go on to time ``t`` [s] under the load of the step of the air that ends there.

        Raises
        ------
        WorkError
            The load is not finite, or the structure finds no equilibrium.
        """
        structure, began, count = self.structure, self.structure.time, self.coupling.substeps
        carried, before = self._carried(load), (structure.save().configuration, self._now)
        state = self._now
        for k in range(1, count + 1):
            target = t if k == count else began + (t - began) * k / count
            state = structure.pushed(target, load.force, carried)
        done = _mean(before, (structure.save().configuration, state), t - began)
        self._owed = done - self._foreseen
        self._now, self._foreseen, self._shown = state, done, done

    def _carried(self, load: SheetLoad) -> Carried:
        """Return what the air was shown when it computed a load."""
        normal = node_normals(self._now.x, self.triangles)
        return Carried(self.coupling.carried_air * load.carried, normal, self._shown.unknowns)

    def settle(self) -> None:
        """Forget what only speeds the work up, so that a run continued from here repeats bit for bit."""
        self.structure.restore(self.structure.save())

    def save(self) -> dict[str, FloatArray]:
        """Return everything needed to go on from here, as arrays by name."""
        motion = self.structure.save()
        out = {name: getattr(motion, name) for name in _ARRAYS}
        for f in fields(Configuration):
            out[f"configuration.{f.name}"] = getattr(motion.configuration, f.name)
        out["time"] = np.array(motion.time)
        out["energies"] = np.array([getattr(motion.energies, f.name) for f in fields(Energies)])
        for name, value in (("done", self._foreseen), ("owed", self._owed)):
            out[f"{name}.unknowns"], out[f"{name}.sheet"] = value.unknowns, value.sheet
        return out

    def restore(self, saved: dict[str, FloatArray]) -> None:
        """Go to a saved instant."""
        parts: dict[str, Any] = {name: saved[name] for name in _ARRAYS}
        configuration = {f.name: saved[f"configuration.{f.name}"] for f in fields(Configuration)}
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
            _Acceleration(saved[f"{name}.unknowns"], saved[f"{name}.sheet"]) for name in ("done", "owed")
        )
        self._foreseen = self._shown = done


_ARRAYS = ("acceleration", "auxiliary", "force", "reaction")


def _mean(
    first: tuple[Configuration, SheetState], last: tuple[Configuration, SheetState], step: float
) -> _Acceleration:
    """Mean accelerations between two instants ``step`` [s] apart."""
    return _Acceleration((last[0].rates - first[0].rates) / step, (last[1].v - first[1].v) / step)


def node_normals(x: FloatArray, triangles: IntArray) -> FloatArray:
    """Return the area-weighted unit normals of the nodes, shape (n, 3).

    Raises
    ------
    WorkError
        A wing has folded up so that a normal vanishes.
    """
    out = _node_areas(x, triangles)
    length = np.linalg.norm(out, axis=1)
    if not np.all(length > 0.0):
        raise WorkError("wing structure: a wing has folded up; its normal vanishes")
    return np.asarray(out / length[:, None])


@compiled
def _node_areas(x: FloatArray, triangles: IntArray) -> FloatArray:
    """Return the sums of twice the area vectors of the triangles around every node [m2], shape (n, 3)."""
    out = np.zeros((len(x), 3))
    for m in range(len(triangles)):
        a, b, c = row(x, triangles[m, 0]), row(x, triangles[m, 1]), row(x, triangles[m, 2])
        area = across(minus(b, a), minus(c, a))
        for k in range(3):
            put_sum(out, triangles[m, k], area)
    return out
