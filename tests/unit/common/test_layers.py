# SPDX-License-Identifier: Apache-2.0
"""The numerics stand without ROS, and the packages know of each other only what they may."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]

# Imports every module outside of the ROS layers in a process where ROS cannot be imported.
_IMPORT_ALL = """
import importlib, pkgutil, sys

BLOCKED = ("rclpy", "cwmav_msgs", "std_msgs", "geometry_msgs", "sensor_msgs", "rcl_interfaces")

class Block:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED:
            raise ImportError(f"{name} is blocked")

sys.meta_path.insert(0, Block())
count = 0
for root in ("cwmav_common", "cwmav_sim", "cwmav_rig", "cwmav_rbdo"):
    package = importlib.import_module(root)
    for module in pkgutil.walk_packages(package.__path__, root + ".", onerror=lambda name: None):
        parts = module.name.split(".")
        if "ros" in parts[1:] or "nodes" in parts[1:] or parts[-1] == "__main__":
            continue
        importlib.import_module(module.name)
        count += 1
print(count)
"""


def test_core_modules_import_without_ros() -> None:
    done = subprocess.run([sys.executable, "-c", _IMPORT_ALL], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 60


def test_layers() -> None:
    linter = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([linter], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout
