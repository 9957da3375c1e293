# SPDX-License-Identifier: Apache-2.0
"""From a recording to the scatter of the controls, lift and power: the whole line on one page.

read -> align clocks -> find cycles -> values per cycle -> spread, correlation, budget.
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
from cwmav_common.mcap_reader import Recording, open_recording
from cwmav_rig import power
from cwmav_rig.airspeed import density
from cwmav_rig.blocks import Block, Series
from cwmav_rig.budget import Measured, budgets
from cwmav_rig.clocks import by_flapping
from cwmav_rig.correlation import correlations
from cwmav_rig.cycles import Cycles, find_cycles
from cwmav_rig.loads import Loads, lift_and_drag
from cwmav_rig.raw_spectrum import remarks
from cwmav_rig.report import RigReport
from cwmav_rig.sources.mcap import load
from cwmav_rig.sources.reader import RigData
from cwmav_rig.spectra import mains_collision, mount_resonance, power_spectrum
from cwmav_rig.streams import (
    LARGEST_BAD_SHARE,
    aligned,
    broken_cycles,
    checked,
    windowed,
)
from cwmav_rig.topic_map import METADATA, TopicMap, resolve
from cwmav_rig.uncertainty import Spread, spread_of_cycles, spread_of_samples

__all__ = ["RigReport", "Study", "aligned", "analyse", "analyse_data", "study", "study_data", "windowed"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Study:
    """A report and what it was made from, for those who draw or write it.

    Attributes
    ----------
    data
        All streams on the clock of the force, in the window.
    per_cycle
        (m,) values of every cycle by quantity (``F`` Hz, ``AoA`` deg, ``U`` m/s, ``lift`` N, ``drag`` N,
        ``power`` W); NaN where the cycle cannot be used.
    """

    report: RigReport
    data: RigData
    topic_map: TopicMap
    cycles: Cycles
    loads: Loads
    per_cycle: Mapping[str, Array]


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
    return study(bag, topic_map, window=window).report


def study(
    bag: str | Path, topic_map: TopicMap | None = None, *, window: tuple[float, float] | None = None
) -> Study:
    """Analyse a recording and keep what the report was made from; see :func:`analyse`."""
    with open_recording(bag) as recording:
        resolved = resolve(recording, topic_map)
        data = load(recording, resolved)
        found = study_data(data, resolved, source=str(bag), window=window)
        synthetic, origin = _origin(recording)
        problems = (*recording.problems, *found.report.problems)
        return replace(
            found, report=replace(found.report, synthetic=synthetic, origin=origin, problems=problems)
        )


def analyse_data(
    data: RigData, topic_map: TopicMap, *, source: str, window: tuple[float, float] | None = None
) -> RigReport:
    """Analyse samples that were read already; see :func:`analyse`."""
    return study_data(data, topic_map, source=source, window=window).report


def study_data(
    data: RigData, topic_map: TopicMap, *, source: str, window: tuple[float, float] | None = None
) -> Study:
    """Analyse samples that were read already and keep them; see :func:`analyse`."""
    if data.force is None:
        raise InputError(
            f"{source}: no force samples; map the force topic (geometry_msgs/WrenchStamped or WrenchBlock)"
        )
    data, clocks = aligned(data, topic_map)
    data = data if window is None else windowed(data, window, source)
    force = data.force
    if force is None:
        raise InputError(f"{source}: no force samples in the window")
    intermittent = topic_map.power.intermittent
    data, problems, streams = checked(source, data, intermittent)
    if force.spectrum is not None:
        problems += [f"{source}: force {remark}" for remark in remarks(force.spectrum, force.names)[:2]]
    cycles = _cycles(force, source)
    flapping = float(np.mean(cycles.frequency[cycles.good]))
    spectra = [found for name in ("fx", "fz") if (found := power_spectrum(force, name)) is not None]
    collision = mains_collision(spectra, flapping)
    problems += [f"{source}: pick-up stays in the force, {collision}"] if collision else []
    data, clocks, clock_notes, clock_remarks = by_flapping(data, topic_map, cycles, clocks)
    angle, angle_cycles = _scatter(data.angle, cycles)
    wind, wind_cycles = _scatter(data.wind, cycles)
    loads = lift_and_drag(
        force, cycles, topic_map, data.tares, angle.mean if angle else None, data.sensor_temperature
    )
    values = {
        "F": cycles.frequency,
        "AoA": _cycle_values(data.angle, angle_cycles, cycles, float(np.degrees(1.0))),
        "U": _cycle_values(data.wind, wind_cycles, cycles),
        "lift": loads.lift,
        "drag": loads.drag,
        "power": None if data.power is None else power.cycle_power(data.power, cycles.bounds),
    }
    per_cycle = {name: np.where(cycles.good, v, np.nan) for name, v in values.items() if v is not None}
    spreads = {
        name: spread_of_cycles(per_cycle[name])
        for name in ("F", "lift", "drag", "power")
        if name in per_cycle and np.isfinite(per_cycle[name]).any()
    }
    lost = {
        "angle_of_attack": ~angle_cycles,
        "wind": ~wind_cycles,
        "power": _missing(data.power, cycles, values),
    }
    gone, notes = _too_many_lost({k: v for k, v in lost.items() if k != "power" or not intermittent})
    quantities: dict[str, Spread | None] = {
        "flapping_frequency": spreads["F"],
        "angle_of_attack": None if "angle_of_attack" in gone else angle,
        "airspeed": None if "wind" in gone else wind,
        "lift": spreads.get("lift"),
        "drag": spreads.get("drag"),
        "power": None if "power" in gone else spreads.get("power"),
    }
    seconds = len(force.values) * force.step
    voltage = 0.0 if data.power is None else float(np.nanmean(data.power.column("voltage")))
    table = budgets(
        Measured(
            topic_map, seconds, spreads["F"], quantities["angle_of_attack"], quantities["airspeed"],
            quantities["lift"], quantities["drag"], quantities["power"], loads, voltage,
        )
    )  # fmt: skip
    report = RigReport(
        source=source,
        synthetic=False,
        origin="measured",
        **quantities,
        cycles=cycles.number,
        clocks=clocks,
        rejected=_rejected(cycles, streams, lost, data.undecodable),
        problems=(*problems, *clock_remarks, *loads.notes, *notes),
        seconds=seconds,
        end_ns=data.origin_ns + round((force.start + len(force.values) * force.step) * 1e9),
        clock_notes=clock_notes,
        correlations=correlations(per_cycle),
        budgets=table,
        mount_resonance=mount_resonance(spectra, flapping),
        air_density=_density(data, topic_map),
        channel_delay=None if data.power is None else power.channel_delay(data.power, cycles.bounds),
    )
    return Study(report, data, topic_map, cycles, loads, per_cycle)


def open_and_load(bag: str | Path, topic_map: TopicMap | None = None) -> tuple[RigData, TopicMap, Recording]:
    """Read all samples of a recording, for callers who want to look at them."""
    with open_recording(bag) as recording:
        resolved = resolve(recording, topic_map)
        return load(recording, resolved), resolved, recording


def _cycles(force: Block, source: str) -> Cycles:
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
    return cycles


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


def _scatter(stream: Series | None, cycles: Cycles) -> tuple[Spread | None, NDArray[np.bool_]]:
    """Spread of a series and the cycles that it covers without a long gap."""
    if stream is None or not len(stream.values):
        return None, np.ones(len(cycles.good), bool)
    whole = ~broken_cycles(stream, cycles.bounds)
    return spread_of_samples(stream.time, stream.values, cycles.bounds, whole), whole


def _cycle_values(
    stream: Series | None, whole: NDArray[np.bool_], cycles: Cycles, factor: float = 1.0
) -> Array | None:
    """Mean of a series in every cycle, (m,); NaN without a sample or beside a gap."""
    if stream is None or not len(stream.values):
        return None
    m = len(cycles.good)
    owner = np.searchsorted(cycles.bounds, stream.time, side="right") - 1
    inside = (owner >= 0) & (owner < m)
    counts = np.bincount(owner[inside], minlength=m)
    sums = np.bincount(owner[inside], factor * stream.values[inside], m)
    return np.where(whole & (counts > 0), sums / np.maximum(counts, 1), np.nan)


def _density(data: RigData, topic_map: TopicMap) -> float | None:
    """Mean density of the air [kg/m3]; None where its temperature is not recorded."""
    if data.air_temperature is None or not len(data.air_temperature.values):
        return None
    recorded = data.ambient_pressure is not None and len(data.ambient_pressure.values) > 0
    pressure = topic_map.wind.ambient_pressure
    if recorded and data.ambient_pressure is not None:
        pressure = float(data.ambient_pressure.values.mean())
    return float(density(float(data.air_temperature.values.mean()), pressure))


def _missing(block: Block | None, cycles: Cycles, values: Mapping[str, Array | None]) -> NDArray[np.bool_]:
    """Cycles within the span of a block that it has no value for, (m,)."""
    found = values["power"]
    if block is None or found is None:
        return np.zeros(len(cycles.good), bool)
    time = block.time
    covered = (cycles.bounds[:-1] > time[0]) & (cycles.bounds[1:] < time[-1])
    return np.asarray(covered & ~np.isfinite(found))


def _too_many_lost(lost: Mapping[str, NDArray[np.bool_]]) -> tuple[set[str], list[str]]:
    """Streams that cannot be used because of their gaps, and what to say of them."""
    gone, notes = set(), []
    for name, cycles in lost.items():
        share = float(cycles.mean()) if len(cycles) else 0.0
        if share > LARGEST_BAD_SHARE:
            gone.add(name)
            notes.append(
                f"{name}: refused, {share:.0%} of the cycles hold a gap;"
                f" at most {LARGEST_BAD_SHARE:.0%} is allowed"
            )
    return gone, notes


def _rejected(
    cycles: Cycles,
    streams: Mapping[str, Block | Series | None],
    lost: Mapping[str, NDArray[np.bool_]],
    undecodable: int,
) -> dict[str, Any]:
    return {
        "cycles": int((~cycles.good).sum()),
        "fraction": cycles.rejected_fraction,
        "reasons": dict(cycles.rejected),
        "cycles_of_stream": {name: int(found.sum()) for name, found in lost.items() if found.any()},
        "samples": {name: dict(s.faults) for name, s in streams.items() if s is not None and s.faults},
        "undecodable_messages": undecodable,
    }
