# SPDX-License-Identifier: Apache-2.0
"""Starting a case from the air that a neighbouring case left behind at the end of its last cycle.

The particles keep their places and pressures. What the wings added to the stream is scaled with the flapping
frequency, as the speed of the wings is, and carried by the new stream:

    v' = U' + (v - U) F'/F,     p' = p (F'/F)^2.

Sides of walls are forgotten, so that a particle that now lies on the other face of a wing stays there.
"""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError, WorkError
from cwmav_common.settings import to_mapping
from cwmav_sim.case import Case, from_dict
from cwmav_sim.devices import AirSolver

FloatArray = NDArray[np.float64]

_NAME = "state.npz"
_SPACE = np.array([26.0, 70.0, 6.0])  # extent of the design space: F [Hz], AoA [deg], U [m/s]
_FREE = ("preset", "flapping_frequency", "angle_of_attack_deg", "airspeed", "run")


@dataclass(frozen=True)
class EndState:
    """The air at the end of a run.

    Attributes
    ----------
    case : Case
        The run.
    address : str
        Its content address, by the solver that ran it.
    x, v : ndarray, shape (n, 3)
        Positions [m] and velocities [m/s] of the particles.
    pressure : ndarray, shape (n,)
        Their pressures without background [Pa].
    """

    case: Case
    address: str
    x: FloatArray
    v: FloatArray
    pressure: FloatArray

    @classmethod
    def of(cls, case: Case, solver: AirSolver) -> EndState:
        """Take the state of a run that has just ended."""
        pressure = solver.pressure - case.flow.fluid.background_pressure
        return cls(case, case.address(), solver.position.copy(), solver.velocity.copy(), pressure)

    @staticmethod
    def there(folder: Path) -> bool:
        """Tell whether the folder of a run holds a state."""
        return (folder / _NAME).exists()

    @classmethod
    def read(cls, folder: Path) -> EndState:
        """Read the state in the folder of a run.

        Raises
        ------
        InputError
            When there is none, or the file is damaged.
        """
        path = folder / _NAME
        if not path.exists():
            raise InputError(f"{path}: is not there; a run leaves it with --keep-state")
        try:
            with path.open("rb") as stream, np.load(stream) as file:
                content = {name: file[name] for name in ("case", "address", "x", "v", "pressure")}
                case = from_dict(json.loads(str(content["case"])), str(path))
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise InputError(f"{path}: holds no state of a run ({error})") from None
        return cls(case, str(content["address"]), content["x"], content["v"], content["pressure"])

    def write(self, folder: Path) -> Path:
        """Write the state; the file appears whole or not at all.

        Raises
        ------
        WorkError
            When the folder cannot be written.
        """
        path = folder / _NAME
        part = path.with_suffix(".part")
        arrays: dict[str, Any] = {
            "case": np.array(json.dumps(to_mapping(self.case))),
            "address": np.array(self.address),
            "x": self.x,
            "v": self.v,
            "pressure": self.pressure,
        }
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with part.open("wb") as file:
                np.savez(file, **arrays)
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        except OSError as error:
            raise WorkError(f"{path}: the state cannot be written ({error})") from None
        return path


def started(case: Case, start: EndState) -> Case:
    """Return a case that starts from a state; its address says from which.

    Raises
    ------
    InputError
        When the two differ in more than the operating point and the length of the run.
    """
    mine, theirs = _flat(to_mapping(case)), _flat(to_mapping(start.case))
    differ = [f"{key} = {theirs[key]} (here {mine[key]})" for key in mine if mine[key] != theirs[key]]
    if differ:
        raise InputError(
            f"run {start.address} was made with {', '.join(differ)}; allowed: only other points and cycles"
        )
    return replace(case, run=replace(case.run, start_from=start.address))


def fill(solver: AirSolver, case: Case, start: EndState | None) -> None:
    """Give the air of a state to a solver that stands at the start of a case made by :func:`started`.

    Raises
    ------
    InputError
        When it is not the state that the case names.
    """
    wanted, found = case.run.start_from or "none", "none" if start is None else start.address
    if start is None or wanted != found:
        raise InputError(f"the run starts from the air of run {wanted}; given: {found}")
    ratio = case.flapping_frequency / start.case.flapping_frequency
    old, new = (np.array([c.airspeed, 0.0, 0.0]) for c in (start.case, case))
    solver.restore(solver.save() | {"x": start.x.copy(), "v": new + ratio * (start.v - old)})
    solver.set_pressure(ratio**2 * start.pressure)


def from_nearest(cases: Sequence[Case]) -> list[Case]:
    """Let every case but the first start from the nearest one before it.

    Distances are shares of the design space. Cases added at the end change none of those before.
    """
    out: list[Case] = []
    points = np.array([[c.flapping_frequency, c.angle_of_attack_deg, c.airspeed] for c in cases])
    for number, case in enumerate(cases):
        if number:
            away = np.linalg.norm((points[:number] - points[number]) / _SPACE, axis=1)
            source = out[int(np.argmin(away))].address()
            case = replace(case, run=replace(case.run, start_from=source))
        out.append(case)
    return out


def _flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key, value in values.items():
        if prefix + key in _FREE:
            continue
        out |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value}
    return out
