# SPDX-License-Identifier: Apache-2.0
"""Live instruments: one protocol, a session that runs several at once, simulated devices for each.

Instruments give the same messages that a recording holds, so that replay, live view and analysis share
everything behind this point. Nothing here knows ROS.
"""

from cwmav_rig.instruments.protocol import Identity, Instrument, InstrumentError, Reading
from cwmav_rig.instruments.session import InstrumentHealth, Session
from cwmav_rig.instruments.settings import BenchSettings, load_bench

__all__ = [
    "BenchSettings",
    "Identity",
    "Instrument",
    "InstrumentError",
    "InstrumentHealth",
    "Reading",
    "Session",
    "load_bench",
]
