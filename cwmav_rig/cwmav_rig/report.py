# SPDX-License-Identifier: Apache-2.0
"""What one recording says, as values and as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cwmav_rig import align
from cwmav_rig.budget import Budget
from cwmav_rig.correlation import Correlations
from cwmav_rig.uncertainty import Spread

_NONE: dict[str, Any] = {"mean": None, "std": None, "std_low": None, "std_high": None, "distribution": None}


@dataclass(frozen=True)
class RigReport:
    """What one recording says; angles in rad, frequency in Hz, SI otherwise. A quantity not recorded is None.

    Attributes
    ----------
    origin
        ``measured``, or that the recording is synthetic and by which power model.
    clocks
        Clock of each stream against the force sensor's.
    clock_notes
        How each clock was found, how well its offset is known [s], the phase lag [deg] of the stream to the
        force, and how far the flapping in it says that it is off [s], as far as they are known.
    correlations
        Between the quantities from cycle to cycle; None with too few cycles.
    budgets
        Everything that makes a mean uncertain, by the names of the JSON keys.
    channel_delay
        Time [s] by which the current seems to lag the voltage; None when it cannot be told.
    rejected
        Cycles left out by reason, and faults of every stream.
    problems
        Sentences a person should read.
    seconds
        Length of the force record [s].
    """

    source: str
    synthetic: bool
    origin: str
    flapping_frequency: Spread | None
    angle_of_attack: Spread | None
    airspeed: Spread | None
    lift: Spread | None
    drag: Spread | None
    power: Spread | None
    cycles: int
    clocks: Mapping[str, align.ClockFit]
    rejected: Mapping[str, Any]
    problems: tuple[str, ...]
    seconds: float
    end_ns: int
    clock_notes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    correlations: Correlations | None = field(default=None, compare=False)
    budgets: Mapping[str, Budget] = field(default_factory=dict)
    channel_delay: float | None = None
    air_density: float | None = None
    mount_resonance: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Give the keys of the public contract and some more."""
        content = {
            "bag": self.source,
            "synthetic": self.synthetic,
            "origin": self.origin,
            "flapping_frequency_hz": _quantity(self.flapping_frequency),
            "angle_of_attack_deg": _quantity(self.angle_of_attack, np.degrees(1.0)),
            "forward_velocity_m_s": _quantity(self.airspeed),
            "lift_n": _quantity(self.lift),
            "drag_n": _quantity(self.drag),
            "power_w": _quantity(self.power),
            "cycles": self.cycles,
            "clock_offsets_s": {name: clock.offset for name, clock in self.clocks.items()},
            "clock_skews": {name: clock.skew for name, clock in self.clocks.items()},
            "clock_residuals_s": {name: clock.residual for name, clock in self.clocks.items()},
            "clock_notes": {name: dict(note) for name, note in self.clock_notes.items()},
            "correlation": None if self.correlations is None else self.correlations.to_json(),
            "budget": {name: budget.to_json() for name, budget in self.budgets.items()},
            "channel_delay_s": self.channel_delay,
            "air_density_kg_m3": self.air_density,
            "mount_resonance_hz": self.mount_resonance,
            "rejected": dict(self.rejected),
            "problems": list(self.problems),
            "seconds": self.seconds,
        }
        plain: dict[str, Any] = _plain(content)
        return plain


def _quantity(spread: Spread | None, factor: float = 1.0) -> dict[str, Any]:
    if spread is None:
        return dict(_NONE)
    best = spread.fits[0] if spread.fits else None
    return {
        "mean": spread.mean * factor,
        "std": spread.std * factor,
        "std_low": spread.std_low * factor,
        "std_high": spread.std_high * factor,
        "distribution": spread.distribution or None,
        "mean_std": spread.mean_std * factor,
        "effective_samples": spread.effective,
        "goodness_of_fit_p": best.p_value if best else None,
        "fits": [
            {
                "name": fit.name,
                "shape": fit.shape,
                "distance": fit.statistic,
                "p": fit.p_value,
                "bic": fit.bic,
            }
            for fit in spread.fits
        ],
    }


def _plain(value: Any) -> Any:
    """Replace what JSON has no word for by null."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
