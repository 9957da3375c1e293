# SPDX-License-Identifier: Apache-2.0
"""Work for the runners of a sweep that takes no time, or kills its process once."""

import os
import signal
import time
from pathlib import Path

from cwmav_sim.case import from_dict
from support.sim_results import result_for

KILL_ONCE = "CWMAV_TEST_KILL_ONCE"  # a file that does not exist until some process has killed itself


def lift_of(case):
    return 0.01 * case.angle_of_attack_deg


def in_process(case, device, threads, channel):
    """Answer; the first process that comes here after the file was named kills itself."""
    marker = os.environ.get(KILL_ONCE)
    if marker:
        try:
            Path(marker).touch(exist_ok=False)
        except FileExistsError:
            pass
        else:
            os.kill(os.getpid(), signal.SIGKILL)
    return result_for(case, lift=lift_of(case))


def on_cluster(values, device):
    """Answer after a while, so that a worker can be lost in the middle."""
    time.sleep(0.3)
    case = from_dict(values)
    return result_for(case, lift=lift_of(case))
