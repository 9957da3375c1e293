# SPDX-License-Identifier: Apache-2.0
"""Wall time of the demo, from the command to its last line."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = [pytest.mark.bench, pytest.mark.timeout(3600)]

ROOT = Path(__file__).parents[2]


def test_demo(benchmarks, tmp_path):
    started = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "cwmav_rbdo.demo", "--runs", tmp_path],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    wall = time.perf_counter() - started
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert "report    " in done.stdout
    benchmarks.cost("make demo, from the command to the report", wall, "s")
