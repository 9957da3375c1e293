# SPDX-License-Identifier: Apache-2.0
"""Let the C library keep the memory that a step frees, for the next step."""

from __future__ import annotations

import ctypes

# Parameters of mallopt (malloc.h of the GNU C library), and the largest value that it takes.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _MOST = -1, -3, 2**31 - 1


def keep_freed_memory() -> None:
    """Let this process keep freed memory instead of giving it back to the system.

    A step asks for the same arrays again. Every page of memory that comes from the system has to be mapped
    and cleared first, and threads wait for each other meanwhile. Where the C library knows no such setting
    nothing happens.
    """
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        for parameter in (_TRIM_THRESHOLD, _MMAP_THRESHOLD):
            library.mallopt(parameter, _MOST)
