# SPDX-License-Identifier: Apache-2.0
"""What is installed: ament files at their places, launchers that run, one version everywhere."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("cwmav_common", "cwmav_sim", "cwmav_rig", "cwmav_rbdo")
NODES = {"cwmav_sim": "sim_node", "cwmav_rig": "rig_node", "cwmav_rbdo": "optimiser_node"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as opened:
        yield opened


def test_ament_finds_the_packages(wheel: zipfile.ZipFile) -> None:
    names = {name.partition(".data/data/")[2] for name in wheel.namelist()}
    for package in PACKAGES:
        assert f"share/{package}/package.xml" in names
        assert f"share/ament_index/resource_index/packages/{package}" in names
    assert "share/cwmav_rbdo/launch/cwmav.launch.py" in names
    assert "share/cwmav_rbdo/config/two_variables.yaml" in names
    assert "share/cwmav_common/cwmav_msgs/msg/WrenchBlock.msg" in names


def test_launchers_are_executable(wheel: zipfile.ZipFile) -> None:
    for package, node in NODES.items():
        (entry,) = (e for e in wheel.infolist() if e.filename.endswith(f"/lib/{package}/{node}"))
        assert (entry.external_attr >> 16) & 0o111 == 0o111


def test_modules_and_their_data_are_inside(wheel: zipfile.ZipFile) -> None:
    names = wheel.namelist()
    assert "cwmav_sim/nodes/sim_node.py" in names
    assert "cwmav_rig/data/power_model.json" in names
    assert "cwmav_rbdo/config/two_variables.yaml" in names
    assert not [name for name in names if name.startswith("tests/")]


def test_one_version_everywhere() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    messages = tomllib.loads((ROOT / "msgs_schema" / "pyproject.toml").read_text())["project"]["version"]
    found = {messages}
    for package in ("msgs_schema", *PACKAGES):
        found.add(ET.parse(ROOT / package / "package.xml").getroot().findtext("version"))  # noqa: S314
    for package in PACKAGES:
        setup = (ROOT / package / "setup.py").read_text()
        found.add(re.search(r'version="([^"]+)"', setup).group(1))  # type: ignore[union-attr]
    assert found == {version}


def test_every_interface_is_built() -> None:
    folder = ROOT / "msgs_schema"
    files = {
        str(p.relative_to(folder)) for kind in ("msg", "srv", "action") for p in folder.glob(f"{kind}/*")
    }
    listed = set(
        re.findall(r"^\s+((?:msg|srv|action)/\w+\.\w+)$", (folder / "CMakeLists.txt").read_text(), re.M)
    )
    assert files == listed


def test_every_field_of_the_interfaces_is_explained() -> None:
    for path in (ROOT / "msgs_schema").glob("[msa]*/*.[msa]*"):
        for line in path.read_text().splitlines():
            if not line or line.startswith("#") or line == "---":
                continue
            kind = line.split()[0]
            own = kind[0].isupper() or "/" in kind or kind.startswith(("string", "bool", "uint"))
            assert own or "#" in line, f"{path.name}: {line}"


def test_setup_scripts_and_distribution_offer_the_same_programs() -> None:
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    offered = set()
    for package, node in NODES.items():
        text = (ROOT / package / "setup.py").read_text()
        ast.parse(text)
        assert f"{node} = {{name}}.nodes.{node}:main" in text
        offered |= set(re.findall(r"(cwmav-\w+) = ", text))
    assert offered == set(scripts)


def test_readme_names_every_library_for_a_system_without_wheels() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = {re.match(r"[\w-]+", entry).group() for entry in project["dependencies"]}
    readme = (ROOT / "README.md").read_text()
    command = re.search(r"pip install --break-system-packages ((?:.*\\\n)*.*)", readme).group(1)
    assert set(command.replace("\\", " ").split()) == needed
