# SPDX-License-Identifier: Apache-2.0
"""From the settings of a bench to its instruments."""

from __future__ import annotations

from collections.abc import Callable

from cwmav_common.errors import InputError
from cwmav_rig.instruments.camera import FolderCamera, StreamCamera
from cwmav_rig.instruments.net_ft import NetFt
from cwmav_rig.instruments.oscilloscope import Oscilloscope
from cwmav_rig.instruments.protocol import Instrument
from cwmav_rig.instruments.settings import BenchSettings
from cwmav_rig.instruments.tunnel import Tunnel


def instruments(bench: BenchSettings) -> list[Instrument]:
    """Make what is on the bench; nothing is opened yet.

    Raises
    ------
    InputError
        Nothing is on the bench, or what an instrument needs is not installed.
    """
    if bench.camera.folder and bench.camera.stream:
        raise InputError("camera: folder and stream are given; allowed: one of them")
    makers: list[tuple[str, Callable[[], Instrument]]] = [
        (bench.force.host, lambda: NetFt(bench.force)),
        (bench.oscilloscope.resource, lambda: Oscilloscope(bench.oscilloscope)),
        (bench.camera.folder, lambda: FolderCamera(bench.camera)),
        (bench.camera.stream, lambda: StreamCamera(bench.camera)),
        (bench.tunnel.resource, lambda: Tunnel(bench.tunnel)),
    ]
    found = [make() for there, make in makers if there]
    if not found:
        raise InputError(
            "no instrument on the bench; give force.host, oscilloscope.resource, camera.folder,"
            " camera.stream or tunnel.resource"
        )
    return found
