# SPDX-License-Identifier: Apache-2.0
"""Streams of a recording made ready for the analysis: on one clock, cut to a window, checked for faults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_rig import align
from cwmav_rig.blocks import Block, Series
from cwmav_rig.sources.reader import RigData
from cwmav_rig.topic_map import TopicMap

Array = NDArray[np.float64]
LARGEST_BAD_SHARE = 0.10  # of samples or of cycles; above it the result is refused
LONGEST_BRIDGE = 2  # missing frames of a series that may be interpolated; a longer gap spoils its cycles


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
    return on_one_clock(data, known), known


def on_one_clock(data: RigData, clocks: Mapping[str, align.ClockFit]) -> RigData:
    """Turn the times of the named streams into those of the reference."""
    power, angle, wind = data.power, data.angle, data.wind
    if power is not None and "power" in clocks:
        fit = clocks["power"]
        start = float(fit.to_reference(np.array([power.start]))[0])
        power = replace(power, start=start, step=power.step / (1.0 + fit.skew))
    if angle is not None and "angle_of_attack" in clocks:
        angle = replace(angle, time=clocks["angle_of_attack"].to_reference(angle.time))
    if wind is not None and "wind" in clocks:
        wind = replace(wind, time=clocks["wind"].to_reference(wind.time))
    return replace(data, power=power, angle=angle, wind=wind)


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


def _cut(block: Block, begin: float, end: float) -> Block:
    keep = (block.time >= begin) & (block.time < end)
    first = int(np.argmax(keep)) if keep.any() else 0
    values = block.values[keep]
    bad = int((~np.isfinite(values).all(axis=1)).sum())
    return replace(block, start=block.start + first * block.step, values=values, samples=len(values), bad=bad)


def _cut_series(data: Series, begin: float, end: float) -> Series:
    keep = (data.time >= begin) & (data.time < end)
    return replace(data, time=data.time[keep], values=data.values[keep])


def checked(
    source: str, data: RigData, intermittent: bool = False
) -> tuple[RigData, list[str], dict[str, Block | Series | None]]:
    """Take out what is too bad to use, and say what was masked.

    Parameters
    ----------
    intermittent
        Gaps in the power are the pauses between captures and no fault.

    Returns
    -------
    RigData
        Without the streams that are refused.
    list of str
        What a person should know.
    dict
        All streams by name as they came, for their counts.

    Raises
    ------
    InputError
        More than 10 % of the force is missing or unusable; without it there are no cycles.
    """
    streams: dict[str, Block | Series | None] = {
        "force": data.force,
        "power": data.power,
        "angle_of_attack": data.angle,
        "wind": data.wind,
    }
    notes, refused = [], set()
    for name, stream in streams.items():
        if stream is None:
            notes.append(f"{source}: {name} is not recorded")
            continue
        faults = ", ".join(f"{count} {fault}" for fault, count in sorted(stream.faults.items()))
        forgiven = intermittent and name == "power"
        if stream.bad_fraction > LARGEST_BAD_SHARE and not forgiven:
            refusal = (
                f"{source}: {stream.bad_fraction:.0%} of the {name} samples are missing or unusable"
                f" ({faults}); at most {LARGEST_BAD_SHARE:.0%} is allowed"
            )
            if name == "force":
                raise InputError(refusal)
            notes.append(f"{refusal}; {name} is refused")
            refused.add(name)
        elif stream.bad:
            notes.append(f"{source}: {stream.bad} of {stream.samples} {name} samples masked ({faults})")
    kept = replace(
        data,
        power=None if "power" in refused else data.power,
        angle=None if "angle_of_attack" in refused else data.angle,
        wind=None if "wind" in refused else data.wind,
    )
    return kept, notes, streams


def broken_cycles(stream: Series, bounds: Array) -> NDArray[np.bool_]:
    """Say which of the cycles between `bounds` (m + 1,) lose frames of a series, (m,)."""
    broken = np.zeros(len(bounds) - 1, bool)
    if len(stream.time) < 2:
        return ~broken
    steps = np.diff(stream.time)
    usual = float(np.median(steps))
    long = steps > (LONGEST_BRIDGE + 1.5) * usual
    for begin, end in zip(stream.time[:-1][long], stream.time[1:][long], strict=True):
        first, last = np.searchsorted(bounds, (begin, end))
        broken[max(first - 1, 0) : last] = True
    return broken
