# SPDX-License-Identifier: Apache-2.0
"""``cwmav-rig`` as a person or a script meets it."""

import json
import sys

import pytest

from cwmav_rig.cli import main
from support.rig_recordings import rewrite


@pytest.fixture
def rig(monkeypatch, capsys):
    """Run the program and give exit status, standard output and standard error."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["cwmav-rig", *map(str, arguments)])
        try:
            main()
            status = 0
        except SystemExit as leave:
            status = leave.code or 0
        out, err = capsys.readouterr()
        assert "Traceback" not in err
        return status, out, err

    return run


SMALL = ("-F", 12, "-A", 15, "-U", 3.5, "--seconds", 3, "--set", "instruments.force_rate=1000")


def test_synthesise_says_what_is_true(rig, tmp_path):
    status, out, _ = rig("synthesise", "--out", tmp_path / "bag", *SMALL, "--seed", 7, "--json")
    content = json.loads(out)
    assert status == 0
    assert content["bag"] == str(tmp_path / "bag")
    assert content["truth"]["flapping_frequency_hz"]["std"] == pytest.approx(0.153)
    assert content["truth"]["synthetic"] is True
    status, out, _ = rig("info", tmp_path / "bag", "--json")
    assert json.loads(out)["synthetic"] is True


def test_info_has_its_keys_and_a_line_per_topic(rig, small_bag):
    status, out, err = rig("info", small_bag, "--json")
    content = json.loads(out)
    assert (status, err) == (0, "")
    assert {"topics", "rates_hz", "gaps", "duration_s", "problems"} <= set(content)
    assert content["rates_hz"]["/rig/wrench_block"] == pytest.approx(20.0, rel=0.02)
    assert content["topics"]["/rig/wrench_block"]["role"] == "force"
    assert content["duration_s"] == pytest.approx(6.0, abs=0.1)
    assert content["problems"] == []
    status, out, _ = rig("info", small_bag)
    assert "SYNTHETIC" in out
    assert sum("/rig/" in line for line in out.splitlines()) == len(content["topics"])


def test_info_shows_a_pause(rig, small_bag, tmp_path):
    from cwmav_common.mcap_reader import open_recording
    from cwmav_common.mcap_writer import BagWriter

    path = tmp_path / "a.mcap"
    with open_recording(small_bag) as recording, BagWriter(path, chunk_size=1000) as bag:
        begin = recording.span_ns[0]
        for message in recording.messages(["/rig/airspeed"]):
            if not begin + 2_000_000_000 < message.log_time_ns < begin + 4_000_000_000:
                bag.write_raw(message.topic, message.type_name, message.data, message.log_time_ns)
    (gap,) = json.loads(rig("info", path, "--json")[1])["gaps"]
    assert gap["length_s"] == pytest.approx(2.0, abs=0.1)


def test_uncertainty_prints_one_object_and_talks_on_standard_error(rig, small_bag):
    status, out, err = rig("uncertainty", small_bag, "--json")
    content = json.loads(out)
    assert status == 0
    assert content["cycles"] > 60
    assert "angle_of_attack samples masked" in err
    status, out, _ = rig("uncertainty", small_bag)
    assert out.splitlines()[0].endswith(f"{content['cycles']} cycles")
    assert "Hz" in out
    assert "clock of power" in out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("uncertainty", "/nowhere/bag"), "/nowhere/bag: no such recording"),
        (("info", "/nowhere/bag"), "/nowhere/bag: no such recording"),
        (("uncertainty", __file__), "is not an MCAP file"),
        (("uncertainty",), "Missing argument"),
        (("synthesise", "--out", "x.mcap", "-F", 500, "-A", 0, "-U", 1), "'flapping_frequency' is 500"),
        (
            ("synthesise", "--out", "x.mcap", "-F", 12, "-A", 0, "-U", 1, "--artefact", "fire=1"),
            "unknown key 'artefacts.fire'; allowed here: bias_drift",
        ),
        (
            ("synthesise", "--out", "/proc/none/x.mcap", "-F", 12, "-A", 0, "-U", 1),
            "/proc/none: cannot be made",
        ),
        (("power", "/nowhere.json", "-F", 12, "-A", 0, "-U", 1), "/nowhere.json: no such power model"),
        (("nonsense",), "nonsense"),
    ],
)
def test_bad_input_is_named_and_ends_with_two(rig, arguments, said):
    status, out, err = rig(*arguments)
    assert status == 2
    assert out == ""
    assert said in err


def test_a_truncated_bag_is_used_as_far_as_it_goes_and_said(rig, small_bag, tmp_path):
    small_chunks = rewrite(small_bag, tmp_path / "chunks.mcap", chunk_size=50_000)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(small_chunks.read_bytes()[: small_chunks.stat().st_size * 6 // 10])
    status, out, err = rig("uncertainty", cut, "--topics", mapped(tmp_path), "--json")
    assert status == 0
    assert 20 < json.loads(out)["cycles"] < 60
    assert f"{cut}: ends or is damaged at byte" in err


def test_a_bag_without_the_needed_topics_is_refused(rig, small_bag, tmp_path):
    from cwmav_common.mcap_reader import open_recording
    from cwmav_common.mcap_writer import BagWriter

    path = tmp_path / "wind.mcap"
    with open_recording(small_bag) as recording, BagWriter(path) as bag:
        for message in recording.messages(["/rig/airspeed"]):
            bag.write_raw(message.topic, message.type_name, message.data, message.log_time_ns)
    status, _, err = rig("uncertainty", path)
    assert status == 2
    assert f"{path}: no force samples; map the force topic" in err
    status, _, err = rig("uncertainty", path, "--topics", mapped(tmp_path))
    assert status == 2
    assert "no topic '/rig/wrench_block' for role force; topics are: /rig/airspeed" in err


def mapped(folder):
    path = folder / "map.yaml"
    path.write_text(
        "force: {topic: /rig/wrench_block}\nangle_of_attack: {topic: /rig/angle_of_attack}\ntare: none\n"
    )
    return path


def test_campaign_and_power(rig, tmp_path):
    settings = ("--set", "seconds=1", "--set", "frequency_low=10", "--set", "airspeed_low=1")
    model = tmp_path / "model.json"
    status, out, _ = rig(
        "campaign", "--out", tmp_path / "c", "--points", 0, "--model", model, *settings, "--json"
    )
    content = json.loads(out)
    assert status == 0
    assert len(content["bags"]) == 16
    assert content["leave_one_out_rms"] < 0.05
    status, out, _ = rig("power", model, "-F", 12, "-A", 20, "-U", 3, "--json")
    answer = json.loads(out)
    assert answer["power_w"] == pytest.approx(1.33, rel=0.05)
    assert answer["inside"] is True
    assert "+-" in rig("power", model, "-F", 12, "-A", 20, "-U", 3)[1]
