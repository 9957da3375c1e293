# SPDX-License-Identifier: Apache-2.0
"""Parameters of the simulation node."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from cwmav_common.settings import setting
from cwmav_sim.case import presets

TABLE = "table"
FIDELITIES = (TABLE, *presets())


@dataclass(frozen=True)
class SimSettings:
    """What `ros2 param list /sim` shows."""

    fidelity: str = setting(
        TABLE,
        "who answers a lift request that names nobody: the bundled table, or a live run of a preset",
        choices=FIDELITIES,
    )
    lift_table: str = setting("", "table of stored runs (CSV of a sweep); empty: the bundled one")
    preset: str = setting("smoke", "preset of a live run that names none", choices=presets())
    workers: int = setting(1, "simulations at the same time", ge=1, le=64)
    device: str = setting("cpu", "where live runs compute", choices=("cpu", "cuda"))
    store: str = setting(
        "", "folder of stored results, which are never computed twice; empty: the user's cache"
    )
    view_rate: float = setting(5.0, "messages on ~/wings and ~/particles at most", unit="Hz", gt=0, le=100)
    publish_particles: bool = setting(False, "publish ~/particles during every run")
    particle_share: float = setting(0.1, "share of the particles on ~/particles", gt=0, le=1)

    def store_folder(self) -> Path:
        """Folder of the stored results."""
        if self.store:
            return Path(self.store)
        cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        return Path(cache) / "cwmav" / "lift"
