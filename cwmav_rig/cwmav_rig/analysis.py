# SPDX-License-Identifier: Apache-2.0
"""From a recording to the scatter of the controls, lift and power: the whole line on one page.

read -> align clocks -> find cycles -> values per cycle -> spread with interval and distribution.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_common.mcap_io import Recording, open_recording
from cwmav_rig import align, loads, power
from cwmav_rig.blocks import Block, Series
from cwmav_rig.cycles import Cycles, find_cycles
from cwmav_rig.sources.mcap import RigData, load
from cwmav_rig.topic_map import METADATA, TopicMap, resolve
from cwmav_rig.uncertainty import Spread, spread_of_cycles, spread_of_samples

Array = NDArray[np.float64]
LARGEST_BAD_SHARE = 0.10  # of samples or of cycles; above it the result is refused
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

    def to_json(self) -> dict[str, Any]:
        """Give the keys of the public contract and some more."""
        return {
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
            "rejected": dict(self.rejected),
            "problems": list(self.problems),
            "seconds": self.seconds,
        }


def analyse(
    bag: str | Path, topic_map: TopicMap | None = None, *, window: tuple[float, float] | None = None
) -> RigReport:
    """Analyse a recording.

    Parameters
    ----------
    bag
        ``.mcap`` file or rosbag2 folder.
    topic_map
        Which topic plays which role; found out from the recording when not given.
    window
        Begin and end [s] from the start of the recording; all of it when not given.

    Raises
    ------
    InputError
        The recording cannot be read, lacks what is needed, or more than 10 % of it is unusable.
    """
    with open_recording(bag) as recording:
        resolved = resolve(recording, topic_map)
        data = load(recording, resolved)
        report = analyse_data(data, resolved, source=str(bag), window=window)
        synthetic, origin = _origin(recording)
        return replace(
            report,
            synthetic=synthetic,
            origin=origin,
            problems=(*recording.problems, *report.problems),
        )


def analyse_data(
    data: RigData, topic_map: TopicMap, *, source: str, window: tuple[float, float] | None = None
) -> RigReport:
    """Analyse samples that were read already; see :func:`analyse`."""
    if data.force is None:
        raise InputError(
            f"{source}: no force samples; map the force topic (geometry_msgs/WrenchStamped or WrenchBlock)"
        )
    data, clocks = aligned(data, topic_map)
    data = data if window is None else windowed(data, window, source)
    force = data.force
    if force is None:
        raise InputError(f"{source}: no force samples in the window")
    streams = {"force": force, "power": data.power, "angle_of_attack": data.angle, "wind": data.wind}
    problems = _refuse_bad(source, streams)
    try:
        cycles = find_cycles(force)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    if cycles.rejected_fraction > LARGEST_BAD_SHARE:
        reasons = ", ".join(f"{count} {reason}" for reason, count in cycles.rejected.items())
        raise InputError(
            f"{source}: {cycles.rejected_fraction:.0%} of {len(cycles.good)} cycles are unusable ({reasons});"
            f" at most {LARGEST_BAD_SHARE:.0%} is allowed"
        )
    angle = _scatter(data.angle, cycles)
    lift, drag, notes = loads.lift_and_drag(
        force, cycles, topic_map, data.tares, angle.mean if angle else None
    )
    return RigReport(
        source=source,
        synthetic=False,
        origin="measured",
        flapping_frequency=spread_of_cycles(np.where(cycles.good, cycles.frequency, np.nan)),
        angle_of_attack=angle,
        airspeed=_scatter(data.wind, cycles),
        lift=lift,
        drag=drag,
        power=_power(data.power, cycles),
        cycles=cycles.number,
        clocks=clocks,
        rejected=_rejected(cycles, streams, data.undecodable),
        problems=(*problems, *notes),
        seconds=len(force.values) * force.step,
        end_ns=data.origin_ns + round((force.start + len(force.values) * force.step) * 1e9),
    )


def aligned(data: RigData, topic_map: TopicMap) -> tuple[RigData, dict[str, align.ClockFit]]:
    """Turn all times into those of the force sensor's clock, as far as trigger edges allow."""
    reference = data.edges.get(topic_map.force.clock, {})
    names = {
        "power": topic_map.power.clock,
        "angle_of_attack": topic_map.angle_of_attack.clock,
        "wind": topic_map.wind.clock,
    }
    fits = {role: align.fit_clock(reference, data.edges.get(clock, {})) for role, clock in names.items()}
    known = {role: fit for role, fit in fits.items() if fit is not None}
    changed = data
    if data.power is not None and "power" in known:
        fit = known["power"]
        start, step = fit.to_reference(np.array([data.power.start])), data.power.step / (1.0 + fit.skew)
        changed = replace(changed, power=replace(data.power, start=float(start[0]), step=step))
    if data.angle is not None and "angle_of_attack" in known:
        times = known["angle_of_attack"].to_reference(data.angle.time)
        changed = replace(changed, angle=replace(data.angle, time=times))
    if data.wind is not None and "wind" in known:
        changed = replace(changed, wind=replace(data.wind, time=known["wind"].to_reference(data.wind.time)))
    return changed, known


def windowed(data: RigData, window: tuple[float, float], source: str) -> RigData:
    """Keep the samples between two times [s] from the first force sample."""
    begin, end = window
    if data.force is None or not begin < end:
        raise InputError(f"{source}: window {begin:g} to {end:g} s; the end must lie after the begin")
    begin, end = begin + data.force.start, end + data.force.start
    return replace(
        data,
        force=_cut(data.force, begin, end),
        power=None if data.power is None else _cut(data.power, begin, end),
        angle=None if data.angle is None else _cut_series(data.angle, begin, end),
        wind=None if data.wind is None else _cut_series(data.wind, begin, end),
    )


def open_and_load(bag: str | Path, topic_map: TopicMap | None = None) -> tuple[RigData, TopicMap, Recording]:
    """Read all samples of a recording, for callers who want to look at them."""
    with open_recording(bag) as recording:
        resolved = resolve(recording, topic_map)
        return load(recording, resolved), resolved, recording


def _origin(recording: Recording) -> tuple[bool, str]:
    """Say whether the recording is marked synthetic, and in words where it comes from."""
    marks = recording.metadata.get(METADATA, {})
    if marks.get("synthetic") != "true":
        return False, "measured"
    try:
        model = json.loads(marks.get("settings", "{}")).get("power_model", "unknown")
    except (json.JSONDecodeError, AttributeError):
        model = "unknown"
    return True, f"synthetic, {model} power"


def _cut(block: Block, begin: float, end: float) -> Block:
    keep = (block.time >= begin) & (block.time < end)
    first = int(np.argmax(keep)) if keep.any() else 0
    values = block.values[keep]
    bad = int((~np.isfinite(values).all(axis=1)).sum())
    return replace(block, start=block.start + first * block.step, values=values, samples=len(values), bad=bad)


def _cut_series(data: Series, begin: float, end: float) -> Series:
    keep = (data.time >= begin) & (data.time < end)
    return replace(data, time=data.time[keep], values=data.values[keep])


def _refuse_bad(source: str, streams: Mapping[str, Block | Series | None]) -> list[str]:
    notes = []
    for name, stream in streams.items():
        if stream is None:
            notes.append(f"{source}: {name} is not recorded")
            continue
        faults = ", ".join(f"{count} {fault}" for fault, count in sorted(stream.faults.items()))
        if stream.bad_fraction > LARGEST_BAD_SHARE:
            raise InputError(
                f"{source}: {stream.bad_fraction:.0%} of the {name} samples are missing or unusable"
                f" ({faults}); at most {LARGEST_BAD_SHARE:.0%} is allowed"
            )
        if stream.bad:
            notes.append(f"{source}: {stream.bad} of {stream.samples} {name} samples masked ({faults})")
    return notes


def _scatter(stream: Series | None, cycles: Cycles) -> Spread | None:
    if stream is None or not len(stream.values):
        return None
    return spread_of_samples(stream.time, stream.values, cycles.bounds)


def _power(block: Block | None, cycles: Cycles) -> Spread | None:
    if block is None:
        return None
    values = power.cycle_power(block, cycles.bounds)
    return spread_of_cycles(np.where(cycles.good, values, np.nan))


def _rejected(
    cycles: Cycles, streams: Mapping[str, Block | Series | None], undecodable: int
) -> dict[str, Any]:
    return {
        "cycles": int((~cycles.good).sum()),
        "fraction": cycles.rejected_fraction,
        "reasons": dict(cycles.rejected),
        "samples": {name: dict(s.faults) for name, s in streams.items() if s is not None and s.faults},
        "undecodable_messages": undecodable,
    }


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
    }
