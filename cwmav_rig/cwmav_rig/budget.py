# SPDX-License-Identifier: Apache-2.0
"""Uncertainty budgets of the mean values, in the sense of the GUM (JCGM 100:2008).

Every row is a standard uncertainty times a sensitivity. Type A rows come from the scatter of this recording,
type B rows from what the topic map says of the instruments. Rows are taken as independent (equation 10 of
the guide); the degrees of freedom of the combination are Welch-Satterthwaite's (equation G.2b), and the
expanded uncertainty covers 95 %.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeGuard

import numpy as np
from scipy import stats

from cwmav_rig.loads import Loads
from cwmav_rig.topic_map import TopicMap
from cwmav_rig.uncertainty import COVERAGE, Spread

FORCE_CLOCK = 50e-6  # relative, of a crystal that nobody compared with another one
MANY = 1e6  # degrees of freedom of a type B row


@dataclass(frozen=True)
class Row:
    """One source of uncertainty.

    Attributes
    ----------
    name, kind, unit
        What it is, ``A`` or ``B``, and the unit of `value`.
    value
        Standard uncertainty of the source.
    sensitivity
        Change of the result per unit of the source.
    dof
        Degrees of freedom of `value`.
    """

    name: str
    kind: str
    value: float
    unit: str
    sensitivity: float = 1.0
    dof: float = MANY

    @property
    def contribution(self) -> float:
        """Standard uncertainty of the result from this source alone."""
        return abs(self.value * self.sensitivity)


@dataclass(frozen=True)
class Budget:
    """Mean value of a quantity with everything that makes it uncertain."""

    quantity: str
    unit: str
    mean: float
    rows: tuple[Row, ...]

    @property
    def combined(self) -> float:
        """Combined standard uncertainty."""
        return float(np.sqrt(sum(row.contribution**2 for row in self.rows)))

    @property
    def dof(self) -> float:
        """Effective degrees of freedom."""
        fourth = sum(row.contribution**4 / row.dof for row in self.rows)
        return float(min(self.combined**4 / fourth, MANY)) if fourth > 0.0 else MANY

    @property
    def coverage_factor(self) -> float:
        """Factor from the combined to the expanded uncertainty."""
        return float(stats.t.ppf(0.5 + COVERAGE / 2.0, max(self.dof, 1.0)))

    @property
    def expanded(self) -> float:
        """Half width of the interval that covers 95 %."""
        return self.coverage_factor * self.combined

    def to_json(self) -> dict[str, Any]:
        """Give the table as plain values."""
        return {
            "unit": self.unit,
            "mean": self.mean,
            "combined_std": self.combined,
            "degrees_of_freedom": self.dof,
            "coverage_factor": self.coverage_factor,
            "expanded": self.expanded,
            "rows": [
                {
                    "source": row.name,
                    "type": row.kind,
                    "std": row.value,
                    "unit": row.unit,
                    "sensitivity": row.sensitivity,
                    "contribution": row.contribution,
                    "degrees_of_freedom": row.dof,
                }
                for row in self.rows
            ],
        }

    def lines(self) -> Iterator[str]:
        """Give the table for a person, the largest contribution first."""
        yield (
            f"{self.quantity:12s} {self.mean:.5g} {self.unit}, combined standard uncertainty"
            f" {self.combined:.2g}, expanded (95 %, k = {self.coverage_factor:.2f})"
            f" {self.expanded:.2g} {self.unit}"
        )
        for row in sorted(self.rows, key=lambda row: -row.contribution):
            share = (row.contribution / self.combined) ** 2 if self.combined else 0.0
            yield (
                f"    {row.name:34s} {row.kind}  u = {row.value:9.3g} {row.unit:5s}"
                f" x {row.sensitivity:9.3g} = {row.contribution:9.3g} {self.unit:4s} {share:5.1%}"
            )


@dataclass(frozen=True)
class Measured:
    """What the budgets are made of; see the analysis. A quantity that is not there is None."""

    topic_map: TopicMap
    seconds: float
    frequency: Spread | None
    angle: Spread | None
    airspeed: Spread | None
    lift: Spread | None
    drag: Spread | None
    power: Spread | None
    loads: Loads
    mean_voltage: float = 0.0


def budgets(measured: Measured) -> dict[str, Budget]:
    """Make the budget of every quantity that was measured, by the names of the report."""
    role = measured.topic_map
    found: dict[str, Budget] = {}
    f, a, u, p = measured.frequency, measured.angle, measured.airspeed, measured.power
    if _known(f):
        rows = [_scatter(f, "Hz"), Row("clock of the force sensor", "B", FORCE_CLOCK, "1", f.mean)]
        found["flapping_frequency_hz"] = Budget("F", "Hz", f.mean, tuple(rows))
    if _known(a):
        degree = float(np.degrees(1.0))
        rows = [
            _scatter(a, "deg", degree),
            Row("zero of the angle", "B", role.angle_of_attack.zero_std_deg, "deg"),
        ]
        found["angle_of_attack_deg"] = Budget("AoA", "deg", a.mean * degree, tuple(rows))
    if _known(u):
        rows = [_scatter(u, "m/s"), Row("gain with blockage", "B", role.wind.gain_std, "1", u.mean)]
        found["forward_velocity_m_s"] = Budget("U", "m/s", u.mean, tuple(rows))
    for key, name, spread, other in (
        ("lift_n", "lift", measured.lift, measured.drag),
        ("drag_n", "drag", measured.drag, measured.lift),
    ):
        if _known(spread) and other is not None:
            found[key] = Budget(name, "N", spread.mean, tuple(_force_rows(measured, name, spread, other)))
    if _known(p):
        scope = role.power
        rows = [
            _scatter(p, "W"),
            Row("voltage gain", "B", scope.voltage_gain_std, "1", p.mean),
            Row("current gain", "B", scope.current_gain_std, "1", p.mean),
            Row("current zero", "B", scope.current_zero_std, "A", measured.mean_voltage),
        ]
        found["power_w"] = Budget("power", "W", p.mean, tuple(rows))
    return found


def _known(spread: Spread | None) -> TypeGuard[Spread]:
    return spread is not None and bool(np.isfinite(spread.mean_std))


def _scatter(spread: Spread, unit: str, factor: float = 1.0) -> Row:
    return Row(
        "scatter over correlated cycles",
        "A",
        spread.mean_std * factor,
        unit,
        1.0,
        max(spread.effective - 1.0, 1.0),
    )


def _force_rows(measured: Measured, name: str, spread: Spread, other: Spread) -> Sequence[Row]:
    """Rows of lift or drag; a small turn of the axes mixes the two, dL/dp = -D and dD/dp = L."""
    role, loads, zero = measured.topic_map.force, measured.loads, measured.loads.zero
    turn = -other.mean if name == "lift" else other.mean
    rows = [
        _scatter(spread, "N"),
        Row("gain of the sensor", "B", role.gain_std, "1", spread.mean),
        Row("alignment of the sensor", "B", loads.pitch_std, "rad", turn),
        # Every cycle rounds anew, because the force moves over many counts.
        Row("resolution", "B", role.resolution / np.sqrt(12.0 * max(spread.samples, 1)), "N", role.gain),
    ]
    if role.frame == "body" and measured.angle is not None:
        zero_std = float(np.radians(measured.topic_map.angle_of_attack.zero_std_deg))
        rows.append(Row("zero of the angle of attack", "B", zero_std, "rad", turn))
    if zero is not None:
        sine, cosine = np.sin(loads.pitch), np.cos(loads.pitch)
        x, z = ("xyz".index(axis[-1]) for axis in (role.axis_thrust, role.axis_lift))
        along, up = (sine, cosine) if name == "lift" else (cosine, sine)
        rows.append(
            Row(
                "wind-off runs",
                "A",
                float(np.hypot(along * zero.std[x], up * zero.std[z])),
                "N",
                role.gain,
                15.0,
            )
        )
        rows.append(Row("drift of the zero between them", "B", _drift(measured), "N", role.gain))
    return rows


def _drift(measured: Measured) -> float:
    """Uncertainty of the mean zero over the run [N].

    A random walk of strength w that is tied down before and after deviates from the straight line between
    by ``w sqrt(T / 12)`` in its mean over T; tied at one end only it deviates by ``w sqrt(T / 3)``.
    """
    zero, role = measured.loads.zero, measured.topic_map.force
    if zero is None:
        return 0.0
    tied = np.isfinite(zero.drift).any()
    typical = role.zero_walk * np.sqrt(measured.seconds / (12.0 if tied else 3.0))
    seen = float(np.nanmax(np.abs(zero.drift))) / np.sqrt(12.0) if tied else 0.0
    return float(max(typical, seen))
