# SPDX-License-Identifier: Apache-2.0
"""Parameters of the optimiser node."""

from __future__ import annotations

from dataclasses import dataclass

from cwmav_common.settings import setting


@dataclass(frozen=True)
class OptimiserSettings:
    """What `ros2 param list /optimiser` shows."""

    run_root: str = setting("runs", "folder in which run folders are made")
    sim: str = setting("/sim", "name of the simulation node")
    rig: str = setting("/rig", "name of the rig node")
    fidelity: str = setting("", "asked of the simulation node at every point; empty: its own choice")
    patience: float = setting(60.0, "how long a service may be missing", unit="s", gt=0, le=86400)
    record: bool = setting(True, "write run.mcap with everything that was published into the run folder")
