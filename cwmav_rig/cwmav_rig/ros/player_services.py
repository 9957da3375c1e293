# SPDX-License-Identifier: Apache-2.0
"""Types of the player services: those of rosbag2 where it is installed, else twins of the same fields."""

from __future__ import annotations

from typing import Any


def _types() -> Any:
    try:
        from rosbag2_interfaces import srv
    except ImportError:
        from cwmav_msgs import srv
    return srv


Pause = _types().Pause
Resume = _types().Resume
Seek = _types().Seek
SetRate = _types().SetRate
