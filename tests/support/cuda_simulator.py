# SPDX-License-Identifier: Apache-2.0
"""Run numba's simulator of a card with one thread at a time; import this before any kernel starts.

The simulator starts a Python thread for each thread of a block and polls them. They hand over to each other
many thousand times, which takes minutes on a busy machine, and two that ask for a shared array at once may
get one each. Here the threads of a block take turns instead: each runs until it waits for the others.
"""

import os
import threading
import traceback
from types import FrameType

os.environ["NUMBA_ENABLE_CUDASIM"] = "1"

import numpy as np
from numba.cuda.simulator.kernel import BlockManager
from numba.cuda.simulator.kernelapi import Dim3


class _Turns(threading.Thread):
    """A thread of a block that runs only in its turn."""

    def __init__(self, work, block, place):
        super().__init__(daemon=True)
        self.blockIdx, self.threadIdx = Dim3(*block), Dim3(*place)
        self.error = None
        self._work = work
        self._turn, self._over = threading.Semaphore(0), threading.Semaphore(0)

    def run(self):
        self._turn.acquire()
        try:
            self._work()
        except BaseException as error:
            self.error = error
        self._work = None
        self._over.release()

    def syncthreads(self):
        """Let the other threads of the block come here too."""
        self._over.release()
        self._turn.acquire()

    def take_turn(self):
        """Run until the thread waits or ends; tell whether there is more to do."""
        self._turn.release()
        self._over.acquire()
        if self.error is not None:
            raise self.error
        return self._work is not None


def _run(self, block, *arguments):
    """Run the threads of one block."""
    places = list(np.ndindex(*self._block_dim))
    if "syncthreads" not in self._f.__code__.co_names:
        this = threading.current_thread()
        this.blockIdx = Dim3(*block)
        for place in places:
            this.threadIdx = Dim3(*place)
            self._f(*arguments)
        return
    threads = [_Turns(lambda: self._f(*arguments), block, place) for place in places]
    for thread in threads:
        thread.start()
    while threads:
        threads = [thread for thread in threads if thread.take_turn()]


def _callers(frame: FrameType) -> list[tuple[str, int]]:
    """Return what the simulator wants to know of a stack: file and line of the kernel that asks.

    The full stack it takes otherwise reads every source file again, in every thread.
    """
    return [(frame.f_back.f_code.co_filename, frame.f_back.f_lineno), ("", 0)]


BlockManager.run = _run
traceback.extract_stack = _callers
