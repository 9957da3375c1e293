# SPDX-License-Identifier: Apache-2.0
"""``cwmav-rig angle`` and ``cwmav-rig synthesise-frames`` as a person types them."""

import csv
import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml

from cwmav_common import interfaces
from cwmav_common.cli import main_guard
from cwmav_common.mcap_reader import open_recording
from cwmav_common.settings import to_mapping
from cwmav_rig.angle.frames import Frame, decode_compressed
from cwmav_rig.angle.measure import measure_frame
from cwmav_rig.angle.overlay import draw_overlay
from cwmav_rig.angle.synthetic import IMAGE_TOPIC, write_bag, write_folder
from cwmav_rig.angle.synthetic_scene import Optics, Pose
from cwmav_rig.angle.write import ANGLE_TOPIC, OVERLAY_TOPIC
from cwmav_rig.cli import cli
from support.camera_frames import DEVICE, EDGE, draw


def run(monkeypatch, capsys, *arguments):
    """Run the program; give exit status, standard output, standard error."""
    monkeypatch.setattr("sys.argv", ["cwmav-rig", *map(str, arguments)])
    status = 0
    try:
        main_guard(cli)()
    except SystemExit as stop:
        status = stop.code or 0
    out, err = capsys.readouterr()
    return status, out, err


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("camera") / "camera.mcap"
    device = replace(DEVICE, frames=30, dropped=0.05, seed=2, optics=Optics(k1=-0.15, focal_px=400))
    return path, write_bag(device, path)


def test_json_tells_the_angle_and_all_counts(bag, monkeypatch, capsys):
    path, truth = bag
    status, out, _ = run(monkeypatch, capsys, "angle", path, "--json")
    result = json.loads(out)
    assert status == 0
    assert result["angle_of_attack_deg"]["mean"] == pytest.approx(np.rad2deg(truth.mean()), abs=0.02)
    assert result["frames"] == result["measured"] == len(truth)
    assert result["dropped_frames"] == 30 - len(truth) > 0
    assert result["synthetic"] is True
    assert result["refused"] == {}
    assert result["frames_per_second"] > 0


def test_lines_for_a_person(bag, monkeypatch, capsys):
    status, out, _ = run(monkeypatch, capsys, "angle", bag[0])
    assert status == 0
    assert "synthetic" in out
    assert "AoA" in out
    assert "frames/s" in out


def test_everything_is_written(bag, tmp_path, monkeypatch, capsys):
    path, truth = bag
    places = [tmp_path / name for name in ("overlays", "angle.mcap", "angle.csv")]
    options = [item for pair in zip(("--overlay", "--out", "--table"), places, strict=True) for item in pair]
    status, out, err = run(monkeypatch, capsys, "angle", path, *options, "--every", 10, "--json")
    assert status == 0, err
    assert json.loads(out)["overlays"] == 3
    assert len(list(places[0].glob("*.png"))) == 3
    with places[2].open() as stream:
        rows = list(csv.DictReader(stream))
    np.testing.assert_allclose([float(row["angle_rad"]) for row in rows], truth, atol=1e-3)
    with open_recording(places[1]) as recording:
        messages = [interfaces.deserialise(m.data, m.type_name) for m in recording.messages([ANGLE_TOPIC])]
        pictures = [interfaces.deserialise(m.data, m.type_name) for m in recording.messages([OVERLAY_TOPIC])]
        assert recording.metadata["cwmav_angle"]["synthetic"] == "true"
    np.testing.assert_allclose([m.value for m in messages], truth, atol=1e-3)
    assert all(0 < m.std < 1e-3 for m in messages)
    assert [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages] == [
        int(row["stamp_ns"]) for row in rows
    ]
    assert decode_compressed(pictures[0], "overlay").shape == (240, 320)


def test_the_overlay_shows_line_points_and_refusal():
    frame = draw(Pose(0.3))
    result = measure_frame(frame, EDGE)
    picture = draw_overlay(frame, result, EDGE)
    grey = cv2.cvtColor(frame.picture, cv2.COLOR_GRAY2BGR)
    x, y = np.rint(result.evidence.line[8]).astype(int)
    assert (picture[y - 3 : y + 4, x - 3 : x + 4] != grey[y - 3 : y + 4, x - 3 : x + 4]).any()
    np.testing.assert_array_equal(picture[200:230, 5:60], grey[200:230, 5:60])
    torn = Frame(4, 0, None, problem="torn")
    card = draw_overlay(torn, measure_frame(torn, EDGE), EDGE)
    assert card.ndim == 3
    assert card.std() > 0


def test_a_topic_map_names_topic_and_settings(bag, tmp_path, monkeypatch, capsys):
    path, truth = bag
    topics = tmp_path / "map.yaml"
    camera = {"method": "markers", "markers": {"diameter_px": 14}, "camera_roll_std_deg": 0.1}
    topics.write_text(yaml.safe_dump({"angle_of_attack": {"topic": IMAGE_TOPIC, "camera": camera}}))
    status, out, err = run(monkeypatch, capsys, "angle", path, "--topics", topics, "--json")
    assert status == 0, err
    result = json.loads(out)
    assert result["method"] == "markers"
    assert result["angle_of_attack_deg"]["systematic_std"] == pytest.approx(0.1)
    assert result["angle_of_attack_deg"]["mean"] == pytest.approx(np.rad2deg(truth.mean()), abs=0.02)


def test_settings_from_file_options_and_assignments(bag, tmp_path, monkeypatch, capsys):
    path, truth = bag
    content = to_mapping(replace(EDGE, edge="lower", edge_to_axis_deg=1.0))
    settings = tmp_path / "settings.yaml"
    settings.write_text(yaml.safe_dump(content))
    arguments = [
        "--settings",
        settings,
        "--region",
        10,
        10,
        300,
        220,
        "--set",
        "finder.spacing_px=6",
        "--json",
    ]
    status, out, err = run(monkeypatch, capsys, "angle", path, *arguments)
    assert status == 0, err
    mean = json.loads(out)["angle_of_attack_deg"]["mean"]
    assert mean == pytest.approx(np.rad2deg(truth.mean()) - 1.0, abs=0.03)


def test_folders_with_their_calibration(tmp_path, monkeypatch, capsys):
    device = replace(DEVICE, frames=4, optics=Optics(k1=-0.3, focal_px=300))
    truth = write_folder(device, tmp_path / "f")
    lens = tmp_path / "f" / "camera_info.yaml"
    status, out, _ = run(monkeypatch, capsys, "angle", tmp_path / "f", "--camera", lens, "--json")
    assert status == 0
    mean = json.loads(out)["angle_of_attack_deg"]["mean"]
    assert mean == pytest.approx(np.rad2deg(truth.mean()), abs=0.03)
    (tmp_path / "f" / "times.csv").unlink()
    status, _, err = run(monkeypatch, capsys, "angle", tmp_path / "f")
    assert (status, "--rate" in err) == (2, True)


@pytest.mark.parametrize(
    ("arguments", "status", "text"),
    [
        (["none.mcap"], 2, "no such recording"),
        (["{bag}", "--topic", "/other"], 2, f"no topic /other; image topics: {IMAGE_TOPIC}"),
        (["{bag}", "--set", "method=guess"], 2, "allowed: one of edge, markers"),
        (["{bag}", "--region", "300", "0", "100", "100"], 2, "pictures are 320 x 240"),
        (["{bag}", "--set", "quality.std_deg=1e-6"], 1, "frames refused"),
        (["{bag}", "--every", "0"], 2, "every"),
        (["{bag}", "--camera", "none.yaml"], 2, "none.yaml: cannot be read"),
    ],
)
def test_failures_say_which_value_and_what_is_allowed(bag, arguments, status, text, monkeypatch, capsys):
    arguments = [argument.format(bag=bag[0]) for argument in arguments]
    found, out, err = run(monkeypatch, capsys, "angle", *arguments)
    assert found == status
    assert out == ""
    assert text in err
    assert "Traceback" not in err


@pytest.mark.parametrize("out", ["camera.mcap", "pictures"])
def test_frames_are_synthesised_with_their_truth(tmp_path, out, monkeypatch, capsys):
    small = ["scene.width=160", "scene.height=120", "scene.body_length_px=120"]
    sets = [item for value in small for item in ("--set", value)]
    arguments = ["--out", tmp_path / out, "-A", 20, "--frames", 3, "--seed", 5, *sets, "--json"]
    status, text, err = run(monkeypatch, capsys, "synthesise-frames", *arguments)
    assert status == 0, err
    result = json.loads(text)
    assert result["synthetic"] is True
    assert result["truth"]["mean_deg"] == pytest.approx(20, abs=1.5)
    assert len(result["truth"]["angles_rad"]) == 3
    assert (tmp_path / out).exists()


def test_bad_encodings_and_full_folders_are_refused(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").write_text("mine")
    status, _, err = run(monkeypatch, capsys, "synthesise-frames", "--out", tmp_path, "--frames", 1)
    assert (status, "is not empty" in err) == (2, True)
    out = tmp_path / "x.mcap"
    status, _, err = run(
        monkeypatch, capsys, "synthesise-frames", "--out", out, "--frames", 1, "--encoding", "gif"
    )
    assert (status, "allowed: mono8, rgb8, bgr8, png, jpeg" in err) == (2, True)
