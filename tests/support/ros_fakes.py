# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for slow cores, importable by the worker processes. The control point says what they do."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

from cwmav_common.errors import CancelledError, InputError, WorkError

HANG, DIE, REFUSE, FAIL = 29.0, 28.0, 27.0, 26.0  # flapping frequencies [Hz]


def hang(channel: Any) -> None:
    """Work until cancelled."""
    while not channel.cancelled():
        time.sleep(0.01)
    raise CancelledError("cancelled, as asked")


def misbehave(what: float, channel: Any) -> None:
    """Do what a flapping frequency stands for; nothing for others."""
    if what == HANG:
        hang(channel)
    elif what == DIE:
        os.kill(os.getpid(), signal.SIGKILL)
    elif what == REFUSE:
        raise InputError("refused, as asked")
    elif what == FAIL:
        raise WorkError("failed, as asked")


def double(number: float, channel: Any) -> float:
    """Report the number, then give twice of it, or misbehave."""
    channel.report(number)
    misbehave(number, channel)
    return 2 * number


def ask_back(question: Any, channel: Any) -> Any:
    """Give what the submitter answers."""
    return channel.ask(question).result(timeout=30)


def process_number(channel: Any) -> int:
    """Give the id of the worker's process."""
    del channel
    return os.getpid()


def surprise(channel: Any) -> None:
    """Raise what nobody expects."""
    del channel
    raise ZeroDivisionError("surprise")


class FakeTable:
    """Lift equal to the flapping frequency in mN, inside up to 20 Hz; refuses more than 30 Hz."""

    def lift(self, flapping_frequency: float, angle_of_attack: float, airspeed: float) -> Any:
        """Answer, or refuse as the real table does."""
        from cwmav_sim.table import LiftEstimate

        if flapping_frequency > 30.0:
            raise InputError(f"F is {flapping_frequency:g} Hz; allowed: 4 to 30 Hz")
        return LiftEstimate(1e-3 * flapping_frequency, 1e-4, "fake table", flapping_frequency <= 20.0)


def live(case: Any, store: Any, device: str, view: Any, channel: Any) -> tuple[Any, bool]:
    """Stand in for a live run: reports what a run reports, and misbehaves by flapping frequency."""
    import numpy as np

    from cwmav_sim.ros.live import Cloud, Surface
    from cwmav_sim.run import Progress
    from support.sim_results import result_for

    motion = case.motion()
    nodes = motion.state(0.0).x.astype(np.float32)
    channel.report(Surface(nodes, motion.triangles, motion.panel, motion.panel_names))
    if view.particle_share:
        channel.report(Cloud(nodes, 0 * nodes, np.arange(len(nodes), dtype=np.float32)))
    for step in (1, 2):
        channel.report(Progress(0.5 * step, step, 2, 0.1 * step, 0.2, 3.0, 0.02, 0.4, 0.19))
    misbehave(case.flapping_frequency, channel)
    return result_for(case, 1e-2 * case.angle_of_attack_deg), False
