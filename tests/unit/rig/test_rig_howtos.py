# SPDX-License-Identifier: Apache-2.0
"""The how-tos for camera frames and for the force sensor say only what works."""

import re
import shlex
from pathlib import Path

import pytest

from cwmav_common.cli import main_guard
from cwmav_rig.cli import cli
from cwmav_rig.instruments import load_bench

HOW_TOS = Path(__file__).parents[3] / "docs" / "how-to"


def blocks(how_to, language):
    text = (HOW_TOS / how_to).read_text()
    found = re.findall(rf"^ *```{language}\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL)
    return [re.sub(r"^   ", "", block, flags=re.MULTILINE) for block in found]


def run(how_to, folder, monkeypatch, capsys):
    """Run every command of a how-to in `folder` and give their number."""
    monkeypatch.chdir(folder)
    (folder / "map.yaml").write_text(blocks(how_to, "yaml")[0])
    commands = [line for block in blocks(how_to, "sh") for line in block.splitlines()]
    for command in commands:
        monkeypatch.setattr("sys.argv", shlex.split(command))
        try:
            main_guard(cli)()
        except SystemExit as stop:
            if stop.code:
                pytest.fail(f"{command}: status {stop.code}, {capsys.readouterr().err}")
    return len(commands)


def test_every_command_for_camera_frames_runs(tmp_path, monkeypatch, capsys):
    assert run("angle-of-attack-from-camera-frames.md", tmp_path, monkeypatch, capsys) >= 9
    assert (tmp_path / "angle.csv").exists()
    assert len(list((tmp_path / "overlays").iterdir())) >= 3


def test_every_command_for_the_force_sensor_runs(tmp_path, monkeypatch, capsys):
    assert run("calibrate-the-force-sensor.md", tmp_path, monkeypatch, capsys) == 6
    told = capsys.readouterr()
    assert "lift" in told.out
    assert "refused" not in told.err
    assert (tmp_path / "pictures" / "phase_average.png").exists()


def test_the_bench_of_the_how_to_is_one(tmp_path):
    path = tmp_path / "bench.yaml"
    path.write_text(blocks("live-instruments.md", "yaml")[0])
    bench = load_bench(path)
    assert bench.force.host
    assert bench.oscilloscope.setup[1] == ":WAV:FORM BYTE"


def test_the_reference_page_is_what_the_program_prints(monkeypatch, capsys):
    """If this fails: ``cwmav-rig settings > docs/reference/rig-settings.md``."""
    monkeypatch.setattr("sys.argv", ["cwmav-rig", "settings"])
    with pytest.raises(SystemExit):
        main_guard(cli)()
    written = (HOW_TOS.parent / "reference" / "rig-settings.md").read_text()
    assert written == capsys.readouterr().out
