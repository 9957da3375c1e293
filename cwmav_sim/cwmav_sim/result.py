# SPDX-License-Identifier: Apache-2.0
"""The outcome of one run, and where it came from."""

from __future__ import annotations

import datetime
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numba
import numpy as np

import cwmav_sim
from cwmav_common.errors import InputError
from cwmav_sim.case import Case
from cwmav_sim.fingerprint import solver_fingerprint
from cwmav_sim.gauges import History


@dataclass(frozen=True)
class Provenance:
    """What made a result: program, solver, machine and date."""

    version: str
    solver: str
    python: str
    numpy: str
    numba: str
    machine: str
    date: str

    @classmethod
    def here(cls, solver: str | None = None) -> Provenance:
        """Describe this program on this machine now (UTC), by default with the solver of prescribed wings."""
        return cls(
            version=cwmav_sim.__version__,
            solver=solver or solver_fingerprint(),
            python=platform.python_version(),
            numpy=np.__version__,
            numba=numba.__version__,
            machine=f"{platform.system()} {platform.machine()}, {numba.get_num_threads()} threads",
            date=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        )


@dataclass(frozen=True)
class LiftResult:
    """Mean forces of one run over whole flapping cycles.

    Attributes
    ----------
    flapping_frequency, angle_of_attack_deg, airspeed : float
        Operating point [Hz, deg, m/s].
    mean_lift, mean_drag : float
        Means over the cycles kept [N].
    lift_std, drag_std : float
        Standard uncertainties of those means from the scatter between cycles [N]; NaN for one cycle.
    mean_power : float
        Mean power given to the air [W].
    cycle_lift : tuple of float
        Mean lift of each cycle from the start [N].
    cycles : int
        Cycles simulated.
    periodic : bool
        Whether the last two cycle means agree.
    dp : float
        Particle spacing [m].
    particles, steps : int
        Size and length of the run.
    wall_s, particle_steps_per_s : float
        Cost.
    device, preset, address : str
        Where it ran, what it started from, and its content address.
    half_model : bool
        Whether a symmetry plane was used.
    provenance : Provenance
        Program, solver, machine and date.
    details : mapping
        Plain values for people: means of the parts of the force, balances of mass, momentum and energy, and
        what the run cost.
    history : History or None
        Forces against time; absent in results read back from a store.
    """

    flapping_frequency: float
    angle_of_attack_deg: float
    airspeed: float
    mean_lift: float
    lift_std: float
    mean_drag: float
    drag_std: float
    mean_power: float
    cycle_lift: tuple[float, ...]
    cycles: int
    periodic: bool
    dp: float
    particles: int
    steps: int
    wall_s: float
    particle_steps_per_s: float
    device: str
    preset: str
    address: str
    half_model: bool
    provenance: Provenance
    details: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)
    history: History | None = field(default=None, repr=False, compare=False)

    def to_json(self) -> dict[str, Any]:
        """Return the public keys, in the units people read."""
        return {
            "F_hz": self.flapping_frequency,
            "AoA_deg": self.angle_of_attack_deg,
            "U_m_s": self.airspeed,
            "mean_lift_n": self.mean_lift,
            "lift_std_n": self.lift_std,
            "mean_drag_n": self.mean_drag,
            "drag_std_n": self.drag_std,
            "mean_power_w": self.mean_power,
            "cycle_lift_n": list(self.cycle_lift),
            "cycles": self.cycles,
            "periodic": self.periodic,
            "dp_m": self.dp,
            "particles": self.particles,
            "steps": self.steps,
            "wall_s": self.wall_s,
            "particle_steps_per_s": self.particle_steps_per_s,
            "device": self.device,
            "preset": self.preset,
            "address": self.address,
            "half_model": self.half_model,
            "provenance": asdict(self.provenance),
            **self.details,
        }

    @classmethod
    def from_json(cls, values: Mapping[str, Any], source: str) -> LiftResult:
        """Rebuild a result from :meth:`to_json`.

        Raises
        ------
        InputError
            When a key is missing; names ``source``.
        """
        try:
            return cls(
                flapping_frequency=values["F_hz"],
                angle_of_attack_deg=values["AoA_deg"],
                airspeed=values["U_m_s"],
                mean_lift=values["mean_lift_n"],
                lift_std=_number(values["lift_std_n"]),
                mean_drag=values["mean_drag_n"],
                drag_std=_number(values["drag_std_n"]),
                mean_power=values["mean_power_w"],
                cycle_lift=tuple(values["cycle_lift_n"]),
                dp=values["dp_m"],
                provenance=Provenance(**values["provenance"]),
                details={name: values[name] for name in _DETAILS if name in values},
                **{name: values[name] for name in _SAME},
            )
        except (KeyError, TypeError) as error:
            raise InputError(f"{source}: is not a stored result ({error})") from None

    def source(self) -> str:
        """Say in one line where the number came from."""
        model = "half model" if self.half_model else "full model"
        state = "periodic" if self.periodic else "not periodic"
        return (
            f"SPH {self.preset}, {1e3 * self.dp:g} mm, {model}, {self.cycles} cycles ({state}), "
            f"{self.device}, version {self.provenance.version}, solver {self.provenance.solver}"
        )


_DETAILS = ("parts", "balance", "cost")
_SAME = (
    "cycles",
    "periodic",
    "particles",
    "steps",
    "wall_s",
    "particle_steps_per_s",
    "device",
    "preset",
    "address",
    "half_model",
)


def _number(value: float | None) -> float:
    """Undo JSON's null for an undefined number."""
    return float("nan") if value is None else float(value)


def describe_point(case: Case) -> str:
    """Say the operating point for messages."""
    return f"F {case.flapping_frequency:g} Hz, AoA {case.angle_of_attack_deg:g} deg, U {case.airspeed:g} m/s"
