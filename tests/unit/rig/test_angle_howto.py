# SPDX-License-Identifier: Apache-2.0
"""The how-to for camera frames says only what works."""

import re
import shlex
from pathlib import Path

import pytest

from cwmav_common.cli import main_guard
from cwmav_rig.cli import cli

HOW_TO = Path(__file__).parents[3] / "docs" / "how-to" / "angle-of-attack-from-camera-frames.md"


def blocks(language):
    found = re.findall(rf"^ *```{language}\n(.*?)^ *```", HOW_TO.read_text(), re.MULTILINE | re.DOTALL)
    return [re.sub(r"^   ", "", block, flags=re.MULTILINE) for block in found]


def test_every_command_of_the_how_to_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "map.yaml").write_text(blocks("yaml")[0])
    commands = [line for block in blocks("sh") for line in block.splitlines()]
    assert len(commands) >= 9
    for command in commands:
        monkeypatch.setattr("sys.argv", shlex.split(command))
        try:
            main_guard(cli)()
        except SystemExit as stop:
            if stop.code:
                pytest.fail(f"{command}: status {stop.code}, {capsys.readouterr().err}")
    assert (tmp_path / "angle.csv").exists()
    assert len(list((tmp_path / "overlays").iterdir())) >= 3
