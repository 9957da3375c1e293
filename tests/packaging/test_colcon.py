# SPDX-License-Identifier: Apache-2.0
"""The same tree as a colcon workspace: all five packages build, and their nodes run from there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("cwmav_common", "cwmav_sim", "cwmav_rig", "cwmav_rbdo")
NODES = {"cwmav_sim": "sim_node", "cwmav_rig": "rig_node", "cwmav_rbdo": "optimiser_node"}


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a copy of the packages; the ROS wheels stand in for an installed Jazzy."""
    folder = tmp_path_factory.mktemp("workspace")
    skip = shutil.ignore_patterns("__pycache__", "*.nbi", "*.nbc")
    for name in ("msgs_schema", *PACKAGES):
        shutil.copytree(ROOT / name, folder / name, ignore=skip)
    colcon = Path(sys.executable).with_name("colcon")
    assert colcon.exists(), "colcon is not installed; `make test-colcon` does that"
    include = folder / "msgs_schema" / "cmake" / "pip_ros.cmake"
    command = [
        colcon,
        "build",
        "--event-handlers",
        "console_direct-",
        "--cmake-args",
        f"-DCMAKE_PROJECT_INCLUDE={include}",
        f"-DPython3_EXECUTABLE={sys.executable}",
        "-DBUILD_TESTING=OFF",
    ]
    environment = os.environ | {"AMENT_PREFIX_PATH": sys.prefix}
    environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{environment['PATH']}"
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.colcon
@pytest.mark.timeout(1200)
def test_every_package_is_built(workspace: Path) -> None:
    for name in ("cwmav_msgs", *PACKAGES):
        share = workspace / "install" / name / "share"
        assert (share / "ament_index" / "resource_index" / "packages" / name).exists()
        assert (share / name / "package.xml").exists()
    share = workspace / "install" / "cwmav_rbdo" / "share" / "cwmav_rbdo"
    assert (share / "launch" / "cwmav.launch.py").exists()
    assert (share / "config" / "two_variables.yaml").exists()


@pytest.mark.colcon
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(("package", "node"), NODES.items())
def test_every_node_starts_from_the_workspace(workspace: Path, package: str, node: str) -> None:
    executable = workspace / "install" / package / "lib" / package / node
    assert os.access(executable, os.X_OK)
    # A parameter of the wrong type ends the start, after everything was imported from the workspace.
    script = f". install/setup.sh && exec {executable} --ros-args -p use_sim_time:=false -p {_wrong(package)}"
    done = subprocess.run(["sh", "-c", script], cwd=workspace, capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert _wrong(package).partition(":=")[0] in done.stderr


@pytest.mark.colcon
@pytest.mark.timeout(1200)
def test_modules_come_from_the_workspace(workspace: Path) -> None:
    code = "import cwmav_rbdo, cwmav_msgs.msg; print(cwmav_rbdo.__file__, cwmav_msgs.__file__)"
    script = f". install/setup.sh && exec {sys.executable} -c '{code}'"
    done = subprocess.run(["sh", "-c", script], cwd=workspace, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert all(path.startswith(str(workspace / "install")) for path in done.stdout.split())


def _wrong(package: str) -> str:
    return {"cwmav_sim": "workers:=0", "cwmav_rig": "rate:=0.0", "cwmav_rbdo": "patience:=soon"}[package]
