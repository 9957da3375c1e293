# SPDX-License-Identifier: Apache-2.0
"""The scatter of the control variables: measured on a rig recording, or given in the problem file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cwmav_common.errors import InputError, WorkError
from cwmav_rbdo.wing_problem import CONTROLS, WingProblem

# Keys of `cwmav-rig uncertainty --json`, in the units of problem files.
_REPORT_KEYS = {"F": "flapping_frequency_hz", "AoA": "angle_of_attack_deg", "U": "forward_velocity_m_s"}


@dataclass(frozen=True)
class Scatter:
    """Standard deviation of one control variable with its 95 % interval, in the units of problem files."""

    std: float
    low: float = math.nan
    high: float = math.nan
    mean: float = math.nan
    distribution: str = "normal"
    formula: str = ""
    """Standard deviation as a function of F, AoA, U where it varies; `std` is then not a number."""


@dataclass(frozen=True)
class Noise:
    """Scatter of F [Hz], AoA [deg] and U [m/s], and where the numbers are from."""

    scatter: Mapping[str, Scatter]
    source: str

    def std(self, name: str) -> float:
        """Give the standard deviation of one control variable."""
        return self.scatter[name].std

    def to_json(self) -> dict[str, Any]:
        """Give plain values."""
        return {
            "source": self.source,
            "scatter": {name: vars(s) | {"unit": CONTROLS[name][0]} for name, s in self.scatter.items()},
        }


def from_json(values: Mapping[str, Any]) -> Noise:
    """Restore what :meth:`Noise.to_json` gave."""
    scatter = {}
    for name, entry in values["scatter"].items():
        numbers = {key: _number(entry[key]) for key in ("std", "low", "high", "mean")}
        scatter[name] = Scatter(
            **numbers, distribution=entry["distribution"], formula=entry.get("formula", "")
        )
    return Noise(scatter, values["source"])


def given(problem: WingProblem) -> Noise:
    """Noise as the problem file gives it."""
    if problem.noise is None:
        raise InputError("noise: the problem file says 'measured', so a recording or the rig node is needed")
    scatter = {}
    for name in CONTROLS:
        value, dist = problem.noise[name], problem.distribution.get(name, "normal")
        varies = isinstance(value, str)
        scatter[name] = Scatter(
            math.nan if varies else float(value), distribution=dist, formula=str(value) if varies else ""
        )
    return Noise(scatter, "given in the problem file")


def from_report(report: Mapping[str, Any], source: str) -> Noise:
    """Noise from the JSON of a rig report.

    Raises
    ------
    WorkError
        The report has no standard deviation for one of the control variables.
    """
    scatter = {}
    for name, key in _REPORT_KEYS.items():
        entry = report.get(key)
        if not isinstance(entry, Mapping) or entry.get("std") is None or not math.isfinite(entry["std"]):
            raise WorkError(
                f"{source}: no scatter of {key} could be measured; give the noise in the problem file"
            )
        scatter[name] = Scatter(
            std=float(entry["std"]),
            low=_number(entry.get("std_low")),
            high=_number(entry.get("std_high")),
            mean=_number(entry.get("mean")),
            distribution=str(entry.get("distribution", "normal")),
        )
    return Noise(scatter, source)


def measured(recording: Path, topic_map: str = "") -> Noise:
    """Measure the noise on a rig recording."""
    from cwmav_rig.analysis import analyse  # deferred: studies with given noise need no rig code
    from cwmav_rig.topic_map import load_topic_map

    report = analyse(recording, load_topic_map(topic_map) if topic_map else None)
    mark = " (synthetic)" if report.synthetic else ""
    return from_report(report.to_json(), f"measured on {recording}{mark}, {report.cycles} cycles")


def obtain(problem: WingProblem) -> Noise:
    """Give the noise of a problem that is solved without ROS: as given, or measured on its recording.

    Raises
    ------
    InputError
        The noise is to be measured and there is no recording.
    """
    if problem.noise is not None:
        return given(problem)
    named = problem.source.scatter_recording
    return measured(Path(named) if named else _bundled_recording(), problem.source.topic_map)


def _bundled_recording() -> Path:
    """Find the recording of the demo, below the working folder or in the source tree."""
    for root in (Path.cwd(), Path(__file__).resolve().parents[2]):
        if (root / "bags" / "demo").is_dir():
            return root / "bags" / "demo"
    raise InputError(
        "noise: measured, but there is no recording bags/demo here; name one in the problem file "
        "(source: {scatter_recording: ..}) or give the noise (noise: {F: .., AoA: .., U: ..})"
    )


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)
