# SPDX-License-Identifier: Apache-2.0
"""An objective that answers, takes its time, hangs or kills its process, by the value of x."""

import os
import signal
import time


def patient(x):
    """Give x back: at once below 50, after 0.2 s from there on; 13 kills the process, 99 hangs."""
    value = float(x[0])
    if value == 13.0:
        os.kill(os.getpid(), signal.SIGKILL)
    if value == 99.0:
        time.sleep(3600.0)
    if value >= 50.0:
        time.sleep(0.2)
    return x
