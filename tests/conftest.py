# SPDX-License-Identifier: Apache-2.0
"""Workers of a test run that share the machine take one thread each.

Two workers of two threads on two cores wait for each other at the end of every parallel loop: a case of 6 s
took 146 s. What more threads compute is tested on its own.
"""

import os

if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
