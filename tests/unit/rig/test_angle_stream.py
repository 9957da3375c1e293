# SPDX-License-Identifier: Apache-2.0
"""Many frames: nothing lost silently, gaps counted, the stream the rest of the rig takes."""

import heapq
import json
from dataclasses import replace

import numpy as np
import pytest

from cwmav_common.errors import InputError, WorkError
from cwmav_common.mcap_reader import open_recording
from cwmav_common.mcap_writer import BagWriter
from cwmav_rig.analysis import analyse
from cwmav_rig.angle.frames import Frame, bag_frames
from cwmav_rig.angle.reader import PictureReader
from cwmav_rig.angle.source import open_source
from cwmav_rig.angle.stream import as_series, measure_frames
from cwmav_rig.angle.synthetic import IMAGE_TOPIC, INFO_TOPIC, SyntheticCamera, write_bag, write_folder
from cwmav_rig.angle.synthetic_scene import Optics, Scene
from cwmav_rig.angle.timing import frame_timing
from cwmav_rig.live import LiveRig
from cwmav_rig.topic_map import from_plain, resolve
from support.camera_frames import DEVICE, EDGE, MARKERS
from support.rig_recordings import split

MS = 1_000_000


def test_regular_frames_have_a_rate_and_no_gaps():
    timing = frame_timing(np.arange(50) * MS)
    assert timing.rate == pytest.approx(1000.0)
    assert (timing.dropped, timing.repeated, timing.backwards, timing.gaps) == (0, 0, 0, ())


def test_missing_frames_are_counted_by_time_and_their_places_told():
    numbers = np.delete(np.arange(60), [10, 30, 31, 32])
    jitter = np.random.default_rng(0).normal(0, 0.05 * MS, len(numbers)).astype(np.int64)
    timing = frame_timing(numbers * MS + jitter)
    assert timing.dropped == 4
    assert timing.gaps == ((10, 1), (29, 3))
    assert timing.jitter == pytest.approx(0.05e-3 * 2**0.5, rel=0.4)


def test_the_camera_s_own_counter_beats_the_clock():
    stamps = np.array([0, 1, 5, 6, 7]) * MS  # a late stamp, not a gap
    assert frame_timing(stamps).dropped == 3
    assert frame_timing(stamps, [4, 5, 6, 7, 8]).dropped == 0
    assert frame_timing(np.arange(4) * MS, [1, 2, 7, 8]).gaps == ((2, 4),)


def test_repeated_frames_and_steps_back_are_counted():
    timing = frame_timing(np.array([0, 1, 1, 2, 3, 4, 3, 5, 6]) * MS)
    assert (timing.repeated, timing.backwards) == (1, 1)
    assert np.isnan(frame_timing(np.array([5])).rate)


def test_all_frames_are_accounted_for():
    frames = [frame for frame, _ in DEVICE.take()]
    frames[3] = replace(frames[3], picture=None, problem="frame 3: torn")
    frames[5] = replace(frames[5], picture=np.full_like(frames[5].picture, 255))
    frames[8] = replace(frames[8], picture=frames[7].picture)
    seen = []
    stream = measure_frames(frames, EDGE, on_frame=lambda frame, result: seen.append(result.measured))
    assert stream.refused == {"unreadable": 1, "saturated": 1, "repeated": 1}
    assert [(refusal.index, refusal.stamp_ns) for refusal in stream.refusals] == [
        (k, frames[k].stamp_ns) for k in (3, 5, 8)
    ]
    assert len(stream.angle) == len(seen) == 20
    assert int(stream.measured.sum()) + sum(stream.refused.values()) == 20
    with pytest.raises(WorkError, match=r"3 of 20 frames refused \(1 unreadable, 1 saturated, 1 repeated\)"):
        stream.statistics(0.1)
    assert stream.statistics(0.2).low > 0.2


def test_no_frames_at_all_are_a_failure_and_not_a_zero():
    stream = measure_frames([], EDGE)
    with pytest.raises(WorkError, match="0 of 0 frames refused"):
        stream.statistics(0.1)


def test_series_counts_missing_and_refused_frames_as_bad_but_not_repeated_ones():
    device = replace(DEVICE, frames=40, dropped=0.1, repeated=0.1, stamp_jitter=0.0, seed=4)
    frames = [frame for frame, _ in device.take()]
    numbers = [frame.number for frame in frames]
    lost, twice = numbers[-1] - numbers[0] + 1 - len(set(numbers)), len(numbers) - len(set(numbers))
    assert lost > 0
    assert twice > 0
    frames[0] = replace(frames[0], picture=None)
    series = as_series(measure_frames(frames, EDGE), device.start_ns)
    assert series.faults["missing"] == lost
    assert series.faults["repeated"] == twice
    assert series.bad == lost + 1
    assert series.samples == len(set(numbers)) + lost
    assert np.all(np.diff(series.time) > 0)


def test_the_error_of_the_frames_is_taken_out_of_the_scatter():
    device = replace(DEVICE, frames=60, wander_deg=0, rocking_deg=0, heave_px=0, optics=Optics(read_noise=12))
    stream = measure_frames((frame for frame, _ in device.take()), replace(MARKERS, camera_roll_std_deg=0.2))
    statistics = stream.statistics(0.1)
    assert statistics.scatter == pytest.approx(statistics.frame_std, rel=0.35)
    assert statistics.motion < statistics.scatter
    assert np.rad2deg(statistics.systematic_std) == pytest.approx(0.2)


@pytest.mark.parametrize("encoding", ["mono8", "rgb8", "png", "jpeg"])
def test_recordings_of_every_kind_give_the_truth(tmp_path, encoding):
    path = tmp_path / "camera.mcap"
    device = replace(DEVICE, frames=6, optics=Optics(k1=-0.2, focal_px=400))
    truth = write_bag(device, path, encoding)
    with open_source(path) as source:
        assert source.synthetic
        assert source.problems == ()
        stream = measure_frames(source.frames, EDGE, source.camera)
    np.testing.assert_allclose(np.rad2deg(stream.angle), np.rad2deg(truth), atol=0.05)


def test_a_folder_gives_what_the_recording_gives(tmp_path):
    truth = write_folder(replace(DEVICE, frames=6), tmp_path / "pictures")
    write_bag(replace(DEVICE, frames=6), tmp_path / "camera.mcap")
    with open_source(tmp_path / "pictures") as source:
        assert source.synthetic
        folder = measure_frames(source.frames, EDGE, source.camera)
    with open_source(tmp_path / "camera.mcap") as source:
        bag = measure_frames(source.frames, EDGE, source.camera)
    np.testing.assert_array_equal(folder.angle, bag.angle)
    np.testing.assert_array_equal(folder.stamps_ns, bag.stamps_ns)
    np.testing.assert_allclose(np.rad2deg(bag.angle), np.rad2deg(truth), atol=0.05)


def test_a_recording_in_pieces_gives_the_same_bits(tmp_path):
    write_bag(replace(DEVICE, frames=8), tmp_path / "camera.mcap")
    parts = split(tmp_path / "camera.mcap", tmp_path / "parts", [0.3, 0.7])
    with open_recording(tmp_path / "camera.mcap") as whole, open_recording(parts) as pieces:
        one = measure_frames(bag_frames(whole, IMAGE_TOPIC), EDGE)
        other = measure_frames(bag_frames(pieces, IMAGE_TOPIC), EDGE)
    np.testing.assert_array_equal(one.angle, other.angle)
    np.testing.assert_array_equal(one.std, other.std)


def test_the_simulated_camera_repeats_itself_and_loses_only_what_it_loses():
    def pictures(device):
        return {frame.number: frame.picture for frame, _ in device.take()}

    device = replace(DEVICE, frames=6)
    first, again, lossy = pictures(device), pictures(device), pictures(replace(device, dropped=0.3))
    assert all(np.array_equal(first[k], again[k]) for k in first)
    assert 0 < len(lossy) < 6
    assert all(np.array_equal(first[k], lossy[k]) for k in lossy)
    assert not np.array_equal(first[0], pictures(replace(device, seed=1))[0])


def with_camera(bag, path, device):
    """Add camera frames to a recording of the rig, from 0.5 s after its start; give the true angles."""
    pictures = path.with_suffix(".camera.mcap")
    with open_recording(bag) as recording, BagWriter(path) as writer:
        write_bag(replace(device, start_ns=recording.span_ns[0] + 500 * MS), pictures)
        with open_recording(pictures) as added:
            for message in heapq.merge(
                recording.messages(), added.messages(), key=lambda message: message.log_time_ns
            ):
                writer.write_raw(message.topic, message.type_name, message.data, message.log_time_ns)
            truth = json.loads(added.metadata["cwmav_camera"]["angle_of_attack_rad"])
    return np.array(truth)


SMALL_SCENE = Scene(width=200, height=150, body_length_px=150, body_thickness_px=24, marker_distance_px=110)
SMALL_CAMERA = SyntheticCamera(
    frames=60,
    rate=12.0,
    scene=SMALL_SCENE,
    optics=Optics(k1=-0.1, focal_px=300),
    heave_px=1,
    wander_time=0.01,
)
MAP = {
    "force": {"topic": "/rig/wrench_block", "frame": "wind"},
    "tare": "none",
    "angle_of_attack": {"topic": IMAGE_TOPIC, "camera": {"method": "markers"}},
}


def test_the_analysis_takes_camera_frames_for_the_angle(small_bag, tmp_path):
    path = tmp_path / "with_camera.mcap"
    truth = with_camera(small_bag, path, SMALL_CAMERA)
    report = analyse(path, from_plain(MAP, "map"))
    assert report.angle_of_attack.mean == pytest.approx(truth.mean(), abs=np.deg2rad(0.05))
    assert report.angle_of_attack.std == pytest.approx(truth.std(), rel=0.1)


def test_frames_that_stream_in_live_give_the_same_report(small_bag, tmp_path):
    path = tmp_path / "with_camera.mcap"
    with_camera(small_bag, path, replace(SMALL_CAMERA, frames=30))
    with open_recording(path) as recording:
        resolved = resolve(recording, from_plain(MAP, "map"))
        assert resolved.angle_of_attack.camera_info == INFO_TOPIC
        live = LiveRig(resolved, recording.topics, str(path))
        messages = list(recording.messages())
    for first in range(0, len(messages), 37):
        live.push(messages[first : first + 37])
    offline = analyse(path, from_plain(MAP, "map"))
    assert live.report().angle_of_attack.mean == pytest.approx(offline.angle_of_attack.mean, abs=1e-12)


def test_pictures_without_their_calibration_are_an_error(small_bag, tmp_path):
    path = tmp_path / "with_camera.mcap"
    with_camera(small_bag, path, replace(SMALL_CAMERA, frames=3))
    named = {**MAP, "angle_of_attack": {"topic": IMAGE_TOPIC, "camera_info": INFO_TOPIC}}
    reader = PictureReader(from_plain(named, "map").angle_of_attack, "live")
    with open_recording(path) as recording:
        for batch in recording.batches([IMAGE_TOPIC]):
            reader.take(batch)
        assert reader.series(0) is None
        with pytest.raises(InputError, match=f"no CameraInfo on {INFO_TOPIC} for 3 camera frames"):
            reader.require_calibration()
        for batch in recording.batches([INFO_TOPIC]):
            reader.take_calibration(batch)
    assert len(reader.series(0).values) == 3


def test_the_analysis_refuses_a_camera_that_saw_nothing(small_bag, tmp_path):
    path = tmp_path / "with_camera.mcap"
    bare = replace(SMALL_SCENE, markers=False)
    with_camera(small_bag, path, replace(SMALL_CAMERA, frames=10, scene=bare))
    report = analyse(path, from_plain(MAP, "map"))
    assert report.angle_of_attack is None
    assert report.flapping_frequency is not None
    (said,) = [problem for problem in report.problems if "angle_of_attack is refused" in problem]
    assert "100% of the angle_of_attack samples" in said
    assert "10 markers" in said


def test_maps_with_a_gain_for_pictures_are_refused(small_bag, tmp_path):
    path = tmp_path / "with_camera.mcap"
    with_camera(small_bag, path, replace(SMALL_CAMERA, frames=2))
    wrong = {**MAP, "angle_of_attack": {"topic": IMAGE_TOPIC, "gain": -1.0}}
    with pytest.raises(InputError, match=r"gain -1.*camera\.nose"):
        analyse(path, from_plain(wrong, "map"))


def test_frames_of_another_size_than_calibrated_are_an_error():
    frames = [Frame(0, 0, np.zeros((50, 60), np.uint8), name="frame 0")]
    camera = replace(DEVICE, optics=Optics(k1=-0.1)).camera
    with pytest.raises(InputError, match="frame 0: picture is 60 x 50"):
        measure_frames(frames, EDGE, camera)
