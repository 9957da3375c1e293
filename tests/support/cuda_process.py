# SPDX-License-Identifier: Apache-2.0
"""Checks of the card in processes of their own: whether numba simulates a card is settled at its import."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cwmav_sim.cuda.device import find_card

TESTS = Path(__file__).parents[1]


def run(module, *arguments):
    """Return what a module prints as JSON."""
    path = os.pathsep.join([str(TESTS), *(p for p in sys.path if p)])
    answer = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert answer.returncode == 0, answer.stderr[-3000:]
    return json.loads(answer.stdout)


def assert_within(differences, allowed):
    """Fail where a difference is larger than allowed, or no number."""
    beyond = {name: value for name, value in differences.items() if not value <= allowed}
    assert not beyond


def skip_without_card():
    """Skip a test of a real card where there is none."""
    if not find_card().usable:
        pytest.skip(find_card().missing)
