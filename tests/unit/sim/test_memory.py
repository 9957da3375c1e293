# SPDX-License-Identifier: Apache-2.0
"""Freed memory is kept where the C library can, and elsewhere nothing happens."""

import ctypes
import resource
import sys

import numpy as np
import pytest

from cwmav_sim.memory import keep_freed_memory


@pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "mallopt"), reason="not the GNU C library"
)
def test_an_array_asked_for_again_needs_no_new_pages():
    keep_freed_memory()
    faults = []
    for _ in range(4):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        np.empty(4_000_000)[:] = 1.0
        faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
    assert min(faults[1:]) < 100  # of 7 800 pages


def test_a_library_without_the_setting_is_left_alone(monkeypatch):
    monkeypatch.setattr(ctypes, "CDLL", lambda name: object())
    keep_freed_memory()
