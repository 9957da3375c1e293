# SPDX-License-Identifier: Apache-2.0
"""Clocks of all streams: by trigger edges where there are any, by the flapping where there are none."""

from __future__ import annotations

from typing import Any

import numpy as np

from cwmav_rig import align
from cwmav_rig.align_phase import fit_phase, lag_of
from cwmav_rig.blocks import Block, Series
from cwmav_rig.cycles import Cycles
from cwmav_rig.sources.reader import RigData
from cwmav_rig.streams import on_one_clock
from cwmav_rig.topic_map import TopicMap

WORST_RESIDUAL = 0.2e-3  # s; a clock that fits worse is remarked
WORST_OFFSET = 20e-3  # s; an offset known no better than this is not used


def by_flapping(
    data: RigData, topic_map: TopicMap, cycles: Cycles, clocks: dict[str, align.ClockFit]
) -> tuple[RigData, dict[str, align.ClockFit], dict[str, dict[str, Any]], list[str]]:
    """Align by the flapping what has no trigger edges, and compare with it what has."""
    streams = {"power": (data.power, "power"), "angle_of_attack": (data.angle, ""), "wind": (data.wind, "")}
    lags = {
        "power": topic_map.power.phase_lag_deg,
        "angle_of_attack": topic_map.angle_of_attack.phase_lag_deg,
        "wind": None,
    }
    found, notes, said = dict(clocks), {}, []
    for role, (stream, column) in streams.items():
        if stream is None:
            continue
        if role in clocks:
            notes[role] = _checked(cycles, stream, column, clocks[role])
            if clocks[role].residual > WORST_RESIDUAL:
                said.append(f"clock of {role}: trigger edges scatter by {clocks[role].residual * 1e3:.2f} ms")
            continue
        lag = lags[role]
        fit = fit_phase(cycles.bounds, stream, column, None if lag is None else float(np.radians(lag)))
        if fit is None or fit.offset_std > WORST_OFFSET:
            notes[role] = {"method": "none"}
            said.append(f"clock of {role}: no trigger edges and no clear flapping in it; taken as it is")
            continue
        found[role] = fit.clock
        notes[role] = {
            "method": "flapping",
            "offset_std_s": fit.offset_std,
            "phase_lag_deg": float(np.degrees(fit.lag)),
        }
        said.append(
            f"clock of {role}: aligned by the flapping, offset {fit.clock.offset * 1e3:+.2f}"
            f" +- {fit.offset_std * 1e3:.2f} ms"
        )
    added = {role: clock for role, clock in found.items() if role not in clocks}
    return on_one_clock(data, added), found, notes, said


def _checked(cycles: Cycles, stream: Block | Series, column: str, clock: align.ClockFit) -> dict[str, Any]:
    note: dict[str, Any] = {"method": "trigger", "offset_std_s": clock.offset_std}
    lag, fit = lag_of(cycles.bounds, stream, column), fit_phase(cycles.bounds, stream, column)
    if lag is not None and fit is not None:
        note |= {
            "phase_lag_deg": float(np.degrees(lag[0])),
            "by_flapping_s": fit.clock.offset,
            "by_flapping_std_s": fit.offset_std,
        }
    return note
