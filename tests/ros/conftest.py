# SPDX-License-Identifier: Apache-2.0
"""Every test here gets a corner of ROS of its own; nothing leaves this machine."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from support.ros_harness import Ros

pytest.importorskip("rclpy", reason="ROS is not installed: pip install .[ros] ./msgs_schema")
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.setdefault("RCUTILS_LOGGING_SEVERITY", "WARN")


@pytest.fixture
def ros() -> Iterator[Ros]:
    from support.ros_harness import Ros

    corner = Ros()
    yield corner
    corner.close()


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a short synthetic recording: F 12 Hz, AoA 15 deg, U 3.5 m/s."""
    from cwmav_common.settings import from_mapping
    from cwmav_rig.synthesis_settings import Synthesis
    from cwmav_rig.synthesise import synthesise

    path = tmp_path_factory.mktemp("bags") / "short.mcap"
    values = {"flapping_frequency": 12.0, "angle_of_attack_deg": 15.0, "airspeed": 3.5, "seconds": 8.0}
    synthesise(path, from_mapping(Synthesis, values, "test"))
    return path
