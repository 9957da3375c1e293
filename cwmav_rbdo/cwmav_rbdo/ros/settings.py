# SPDX-License-Identifier: Apache-2.0
"""Parameters of the optimiser node."""

from __future__ import annotations

from dataclasses import dataclass

from cwmav_common.errors import InputError
from cwmav_common.settings import setting


@dataclass(frozen=True)
class OptimiserSettings:
    """What `ros2 param list /optimiser` shows."""

    run_root: str = setting("runs", "folder in which run folders are made")
    sim: str = setting("/sim", "name of the simulation node; of several, separated by commas")
    rig: str = setting("/rig", "name of the rig node")
    fidelity: str = setting("", "asked of the simulation node at every point; empty: its own choice")
    patience: float = setting(60.0, "how long a service may be missing", unit="s", gt=0, le=86400)
    record: bool = setting(True, "write run.mcap with everything that was published into the run folder")

    @property
    def sims(self) -> tuple[str, ...]:
        """Names of the simulation nodes."""
        return tuple(name.strip() for name in self.sim.split(",") if name.strip())

    def __post_init__(self) -> None:
        if not self.sims:
            raise InputError("sim is empty; expected the name of a simulation node, or several with commas")
        if len(set(self.sims)) < len(self.sims):
            raise InputError(f"sim is '{self.sim}': a node is named twice")
