# SPDX-License-Identifier: Apache-2.0
"""From a recording to numbers: accuracy, tare, clocks, refusals."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import open_recording
from cwmav_common.mcap_writer import BagWriter
from cwmav_rig.align import fit_clock
from cwmav_rig.analysis import analyse
from cwmav_rig.loads import to_wind_axes
from cwmav_rig.synthesis_settings import Artefacts, Synthesis
from cwmav_rig.synthesise import synthesise
from cwmav_rig.topic_map import from_plain, load_topic_map
from support.rig_recordings import SMALL, translate


def test_the_papers_point_gives_back_its_standard_deviations(full_bag):
    report = analyse(full_bag)
    for spread, truth, factor in (
        (report.flapping_frequency, 0.153, 1.0),
        (report.angle_of_attack, 0.462, np.degrees(1.0)),
        (report.airspeed, 0.05, 1.0),
    ):
        assert spread.std_low * factor <= truth <= spread.std_high * factor
        assert spread.std_high < 1.5 * spread.std_low
    assert report.cycles > 350
    assert report.synthetic
    assert report.origin == "synthetic, physical power"


def test_means_agree_with_the_truth(tmp_path):
    """Without drift and gain error, lift is right to 0.3 mN and power to 0.1 %."""
    settings = Synthesis(
        seconds=20.0, seed=4, artefacts=Artefacts(bias_drift=0.0, thermal=0.0, gain_error=0.0)
    )
    truth = synthesise(tmp_path / "a.mcap", settings)
    report = analyse(tmp_path / "a.mcap")
    realised = truth.flapping_frequency_hz["realised_mean"]
    assert report.flapping_frequency.mean == pytest.approx(realised, rel=1e-3)
    assert np.degrees(report.angle_of_attack.mean) == pytest.approx(15.0, abs=0.1)
    assert report.airspeed.mean == pytest.approx(truth.forward_velocity_m_s["realised_mean"], abs=0.005)
    assert report.lift.mean == pytest.approx(truth.lift_n, abs=3e-4)
    assert report.drag.mean == pytest.approx(truth.drag_n, abs=3e-4)
    assert report.power.mean == pytest.approx(truth.power_w, rel=1e-3)


def test_clocks_are_recovered(full_bag):
    report = analyse(full_bag)
    with open_recording(full_bag) as recording:
        truth = json.loads(recording.metadata["cwmav"]["truth"])
    offsets, skews = truth["clock_offsets_s"], truth["clock_skews"]
    for role, clock in {"power": "power", "angle_of_attack": "camera", "wind": "tunnel"}.items():
        assert report.clocks[role].offset == pytest.approx(offsets[clock], abs=1e-4)
        assert report.clocks[role].skew == pytest.approx(skews[clock], abs=5e-6)
        assert report.clocks[role].residual < 1e-4
    assert max(abs(offset) for offset in offsets.values()) > 0.01


def test_json_has_the_keys_of_the_contract(small_bag):
    content = analyse(small_bag).to_json()
    for name in ("flapping_frequency_hz", "angle_of_attack_deg", "forward_velocity_m_s", "lift_n", "power_w"):
        assert {"mean", "std", "std_low", "std_high", "distribution"} <= set(content[name])
        assert content[name]["std_low"] < content[name]["std"] < content[name]["std_high"]
    assert {"cycles", "clock_offsets_s", "rejected"} <= set(content)
    json.dumps(content, allow_nan=False)


def mapped(**changes):
    base = {
        "force": {"topic": "/rig/wrench_block"},
        "power": {"topic": "/rig/power_block"},
        "angle_of_attack": {"topic": "/rig/angle_of_attack"},
        "wind": {"topic": "/rig/airspeed"},
        "tare": {"topic": "/rig/tare_block"},
    }
    return from_plain({k: v for k, v in {**base, **changes}.items() if v is not None}, "map")


def test_tare_none_must_be_said_and_is_remarked(small_bag, tmp_path):
    with_tare = analyse(small_bag, mapped())
    without = analyse(small_bag, mapped(tare="none"))
    weight = SMALL.artefacts.weight
    # A zero of the sensor of up to 0.05 N is in it, too.
    assert without.lift.mean == pytest.approx(with_tare.lift.mean - weight, abs=0.08)
    assert any("no tare" in problem for problem in without.problems)
    unsaid = analyse(small_bag, mapped(tare=None))
    assert unsaid.lift is None
    assert any("refused, no wind-off tare" in problem for problem in unsaid.problems)
    path = tmp_path / "map.yaml"
    path.write_text("force: {topic: /rig/wrench_block}\n")
    with pytest.raises(InputError, match=r"map\.yaml: 'tare' is missing"):
        load_topic_map(path)


def test_a_wind_off_recording_serves_as_tare(small_bag, tmp_path):
    blocks = []

    def only_tare(message, decoded):
        if message.topic == "/rig/tare_block":
            blocks.append(1)
            return [("/rig/wrench_block", message.type_name, decoded)]
        return []

    translate(small_bag, tmp_path / "wind_off.mcap", only_tare)
    (tmp_path / "map.yaml").write_text(
        yaml.safe_dump(
            {
                "force": {"topic": "/rig/wrench_block"},
                "angle_of_attack": {"topic": "/rig/angle_of_attack"},
                "tare": "wind_off.mcap",
            }
        )
    )
    found = analyse(small_bag, load_topic_map(tmp_path / "map.yaml"))
    assert len(blocks) == 2
    assert found.lift.mean == pytest.approx(analyse(small_bag).lift.mean, abs=5e-3)
    assert found.power is None


def test_roles_that_are_not_recorded_are_none_and_said(small_bag):
    report = analyse(small_bag, mapped(power=None, wind=None, angle_of_attack=None))
    assert report.power is report.airspeed is report.angle_of_attack is report.lift is None
    assert sum("is not recorded" in problem for problem in report.problems) == 3
    assert report.to_json()["power_w"] == {
        "mean": None,
        "std": None,
        "std_low": None,
        "std_high": None,
        "distribution": None,
    }


def test_a_window_uses_only_what_lies_in_it(small_bag):
    whole, part = analyse(small_bag), analyse(small_bag, window=(1.0, 4.0))
    assert part.seconds == pytest.approx(3.0, abs=0.01)
    assert 30 < part.cycles < 40 < whole.cycles
    with pytest.raises(InputError, match="end must lie after the begin"):
        analyse(small_bag, window=(3.0, 3.0))
    with pytest.raises(InputError, match="no cycles|force"):
        analyse(small_bag, window=(100.0, 200.0))


def test_a_turned_sensor_is_turned_back(tmp_path):
    settings = replace(SMALL, artefacts=Artefacts(misalignment_deg=5.0, bias_drift=0.0, gain_error=0.0))
    truth = synthesise(tmp_path / "a.mcap", settings)
    turned = mapped(force={"topic": "/rig/wrench_block", "pitch_deg": 5.0})
    assert analyse(tmp_path / "a.mcap", turned).lift.mean == pytest.approx(truth.lift_n, abs=1e-3)
    assert analyse(tmp_path / "a.mcap", mapped()).lift.mean != pytest.approx(truth.lift_n, abs=1e-3)


def test_wind_axes():
    lift, drag = to_wind_axes(np.array([1.0]), np.array([0.0]), np.radians(30.0))
    assert lift[0] == pytest.approx(0.5)
    assert drag[0] == pytest.approx(-np.cos(np.radians(30.0)))


@pytest.mark.parametrize(
    ("artefact", "fault"),
    [({"nan_samples": 0.02}, "nan"), ({"lost_blocks": 0.01}, "lost"), ({"stuck": 0.01}, "stuck")],
)
def test_faults_are_counted_and_their_cycles_left_out(tmp_path, artefact, fault):
    settings = replace(SMALL, seconds=15.0)
    synthesise(tmp_path / "whole.mcap", settings)
    synthesise(tmp_path / "a.mcap", replace(settings, artefacts=Artefacts(**artefact)))
    whole, report = analyse(tmp_path / "whole.mcap"), analyse(tmp_path / "a.mcap")
    assert report.rejected["samples"]["force"][fault] > 0
    assert 0 < report.rejected["cycles"] == sum(report.rejected["reasons"].values())
    assert any("masked" in problem and fault in problem for problem in report.problems)
    assert report.flapping_frequency.mean == pytest.approx(whole.flapping_frequency.mean, rel=2e-3)
    assert report.flapping_frequency.std == pytest.approx(whole.flapping_frequency.std, rel=0.08)
    assert report.lift.mean == pytest.approx(whole.lift.mean, abs=1e-3)


def test_too_much_damage_is_refused_with_the_reason(tmp_path):
    settings = replace(SMALL, artefacts=Artefacts(lost_blocks=0.3))
    synthesise(tmp_path / "a.mcap", settings)
    with pytest.raises(InputError, match=r"a\.mcap: \d\d% of the force samples are missing .* at most 10%"):
        analyse(tmp_path / "a.mcap")


def test_a_map_that_does_not_fit_is_refused(small_bag):
    with pytest.raises(InputError, match=r"no topic '/nope' for role force; topics are: /rig/air_pressure"):
        analyse(small_bag, mapped(force={"topic": "/nope"}))
    with pytest.raises(InputError, match=r"role wind accepts: geometry_msgs"):
        analyse(small_bag, mapped(wind={"topic": "/rig/wrench"}))
    with pytest.raises(InputError, match="mapped together"):
        analyse(small_bag, mapped(power=None, voltage={"topic": "/rig/trigger"}))
    with pytest.raises(InputError, match="no force samples"):
        analyse(small_bag, mapped(force=None))
    with pytest.raises(InputError, match=r"unknown key 'force\.axis'; allowed here: alignment, axis_lift"):
        mapped(force={"topic": "/x", "axis": "z"})
    with pytest.raises(InputError, match="'tare' is"):
        mapped(tare={"file": "x"})


def test_a_foreign_recording_is_understood_by_its_types(small_bag, tmp_path):
    def renamed(message, decoded):
        names = {
            "/rig/wrench_block": "/ft/blocks",
            "/rig/angle_of_attack": "/camera/angle",
            "/rig/airspeed": "/tunnel/speed",
            "/rig/power_block": "/scope",
            "/rig/tare_block": "/ft/tare",
        }
        return [(names[message.topic], message.type_name, decoded)] if message.topic in names else []

    copy = translate(small_bag, tmp_path / "copy.mcap", renamed)
    found, expected = analyse(copy), analyse(small_bag)
    assert not found.synthetic
    assert found.origin == "measured"
    assert found.flapping_frequency == expected.flapping_frequency
    assert found.lift.mean == pytest.approx(expected.lift.mean, rel=1e-6)


def test_clock_fit_needs_common_edges_and_survives_a_bad_one():
    edges = {k: float(k) for k in range(20)}
    other = {k: 0.05 + (1 + 5e-5) * k for k in range(5, 25)}
    other[9] += 0.3
    fit = fit_clock(edges, other)
    assert fit.offset == pytest.approx(0.05, abs=1e-9)
    assert fit.skew == pytest.approx(5e-5, abs=1e-9)
    np.testing.assert_allclose(fit.to_reference(np.array([0.05, 10.05])), [0.0, 10.0 / (1 + 5e-5)], atol=1e-8)
    assert fit_clock(edges, {}) is None
    assert fit_clock({3: 1.0}, {3: 1.2}).offset == pytest.approx(0.2)


def test_undecodable_messages_are_counted(small_bag, tmp_path):
    copy = tmp_path / "copy.mcap"
    with open_recording(small_bag) as recording, BagWriter(copy) as bag:
        for name, values in recording.metadata.items():
            bag.add_metadata(name, values)
        for k, message in enumerate(recording.messages()):
            data = message.data[:11] if message.topic == "/rig/airspeed" and k % 50 == 0 else message.data
            bag.write_raw(message.topic, message.type_name, data, message.log_time_ns)
    assert analyse(copy).rejected["undecodable_messages"] > 0
