# SPDX-License-Identifier: Apache-2.0
"""Frames out of messages, recordings and folders."""

import csv

import cv2
import numpy as np
import pytest

from cwmav_common import interfaces
from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import open_recording
from cwmav_common.mcap_writer import BagWriter
from cwmav_rig.angle.folder import folder_frames
from cwmav_rig.angle.frames import (
    CAMERA_INFO,
    COMPRESSED,
    IMAGE,
    bag_camera,
    bag_frames,
    decode_compressed,
    decode_image,
    frame_of,
)
from cwmav_rig.angle.source import open_source

GREY = np.random.default_rng(0).integers(0, 256, (24, 32), dtype=np.uint8)


def image(picture, encoding, step=None, *, big=0):
    rows, columns = picture.shape[:2]
    line = picture.reshape(rows, -1).view(np.uint8)
    step = step or line.shape[1]
    data = np.zeros((rows, step), np.uint8)
    data[:, : line.shape[1]] = line
    values = {"height": rows, "width": columns, "encoding": encoding, "step": step, "is_bigendian": big}
    return interfaces.new(IMAGE, header=interfaces.header(7), data=data.ravel(), **values)


@pytest.mark.parametrize("encoding", ["mono8", "8UC1"])
def test_grey_pictures_come_back_as_they_are_with_padded_lines(encoding):
    np.testing.assert_array_equal(decode_image(image(GREY, encoding, step=40), "x"), GREY)


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "8UC3"])
def test_colour_pictures_of_grey_things_are_grey(encoding):
    colour = np.repeat(GREY[:, :, None], 3, axis=2)
    np.testing.assert_allclose(decode_image(image(colour, encoding), "x"), GREY, atol=1)


def test_red_and_blue_are_not_confused():
    red = np.zeros((24, 32, 3), np.uint8)
    red[:, :, 0] = 200
    assert decode_image(image(red, "rgb8"), "x")[0, 0] == pytest.approx(0.299 * 200, abs=1)
    assert decode_image(image(red, "bgr8"), "x")[0, 0] == pytest.approx(0.114 * 200, abs=1)


@pytest.mark.parametrize(("order", "big"), [("<u2", 0), (">u2", 1)])
def test_sixteen_bits_in_either_byte_order(order, big):
    deep = GREY.astype(np.uint16) * 257 + 3
    np.testing.assert_array_equal(decode_image(image(deep.astype(order), "mono16", big=big), "x"), deep)


def test_a_bayer_mosaic_of_even_light_is_even():
    even = np.full((24, 32), 90, np.uint8)
    np.testing.assert_allclose(decode_image(image(even, "bayer_rggb8"), "x"), 90, atol=1)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_compressed_pictures(suffix):
    smooth = np.add.outer(np.arange(24), np.arange(32)).astype(np.uint8)
    _, data = cv2.imencode(suffix, smooth)
    message = interfaces.new(COMPRESSED, format="jpeg", data=data.ravel())
    np.testing.assert_allclose(decode_compressed(message, "x"), smooth, atol=0 if suffix == ".png" else 4)


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (image(GREY, "yuv422"), "yuv422.*allowed: mono8"),
        (interfaces.new(IMAGE, height=24, width=32, step=32, encoding="mono8", data=[1, 2]), "2 bytes"),
        (interfaces.new(IMAGE, height=24, width=32, step=8, encoding="mono8", data=[0] * 192), "step 8"),
    ],
)
def test_pictures_that_do_not_fit_say_so(message, text):
    with pytest.raises(InputError, match=text):
        decode_image(message, "/camera frame 3")


@pytest.mark.parametrize("data", [[], [1, 2, 3], list(b"\x89PNG\r\n\x1a\n broken")])
def test_bytes_that_are_no_picture_say_so(data):
    message = interfaces.new(COMPRESSED, format="png", data=data)
    with pytest.raises(InputError, match=r"frame 9.*no readable picture"):
        decode_compressed(message, "frame 9")


def test_damaged_messages_become_frames_with_a_problem():
    frame = frame_of(b"\x00\x01\x00\x00rubbish", IMAGE, 55, 3, "frame 3")
    assert frame.picture is None
    assert (frame.index, frame.stamp_ns) == (3, 55)
    assert "Image" in frame.problem


def test_stamps_are_those_of_acquisition_and_else_those_of_the_log(tmp_path):
    path = tmp_path / "x.mcap"
    with BagWriter(path) as bag:
        stamped = image(GREY, "mono8")
        bag.write("/c/image", IMAGE, stamped, 1000)
        unstamped = image(GREY, "mono8")
        unstamped.header = interfaces.header(0)
        bag.write("/c/image", IMAGE, unstamped, 2000)
    with open_recording(path) as recording:
        assert [frame.stamp_ns for frame in bag_frames(recording, "/c/image")] == [7, 2000]


def test_topics_that_hold_no_pictures_are_refused_by_name(tmp_path):
    path = tmp_path / "x.mcap"
    with BagWriter(path) as bag:
        bag.write("/c/image", IMAGE, image(GREY, "mono8"), 1)
        bag.write("/c/camera_info", CAMERA_INFO, interfaces.new(CAMERA_INFO, width=32, height=24), 1)
    with open_recording(path) as recording:
        with pytest.raises(InputError, match=r"no topic /d; image topics: /c/image"):
            bag_frames(recording, "/d")
        with pytest.raises(InputError, match="CameraInfo; allowed: sensor_msgs/msg/Image"):
            bag_frames(recording, "/c/camera_info")
        with pytest.raises(InputError, match="/c/image is no topic of"):
            bag_camera(recording, "/c/image")
        assert bag_camera(recording, "/c/camera_info") is None  # all zero: not calibrated


def test_a_calibration_that_changes_on_the_way_is_refused(tmp_path):
    path = tmp_path / "x.mcap"
    with BagWriter(path) as bag:
        for k in range(3):
            camera = interfaces.new(CAMERA_INFO, width=32, height=24 + (k == 2))
            bag.write("/c/camera_info", CAMERA_INFO, camera, 10 * k)
            bag.write("/c/image", IMAGE, image(GREY, "mono8"), 10 * k + 1)
    with (
        open_recording(path) as recording,
        pytest.raises(InputError, match="/c/camera_info changes at frame 2"),
    ):
        list(bag_frames(recording, "/c/image", "/c/camera_info"))


def write_pictures(folder, names):
    folder.mkdir()
    for name in names:
        assert cv2.imwrite(str(folder / name), GREY)
    return folder


def test_a_missing_number_in_a_folder_leaves_its_gap_in_time(tmp_path):
    folder = write_pictures(tmp_path / "f", ["a_8.png", "a_9.png", "a_11.png", "a_10.bmp"][:3])
    frames = list(folder_frames(folder, rate=1000.0))
    assert [frame.number for frame in frames] == [8, 9, 11]  # by number: 11 is not before 8
    assert [frame.stamp_ns for frame in frames] == [0, 1_000_000, 3_000_000]
    np.testing.assert_array_equal(frames[0].picture, GREY)


def test_a_table_of_times_wins(tmp_path):
    folder = write_pictures(tmp_path / "f", ["a1.png", "b2.png"])
    with (folder / "times.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows([("file", "stamp_ns"), ("a1.png", 50), ("b2.png", 90)])
    assert [frame.stamp_ns for frame in folder_frames(folder)] == [50, 90]
    (folder / "times.csv").write_text("file,stamp_ns\na1.png,50\n")
    with pytest.raises(InputError, match=r"no time for b2\.png"):
        folder_frames(folder)
    (folder / "times.csv").write_text("file,stamp_ns\na1.png,soon\n")
    with pytest.raises(InputError, match=r"times\.csv.*integer nanoseconds"):
        folder_frames(folder)


def test_folders_without_what_is_needed_say_what(tmp_path):
    folder = write_pictures(tmp_path / "f", ["a1.png", "b1.png"])
    with pytest.raises(InputError, match="--rate above 0 Hz, got None"):
        folder_frames(folder)
    with pytest.raises(InputError, match="same number"):
        folder_frames(folder, rate=100.0)
    with pytest.raises(InputError, match="holds no pictures"):
        folder_frames(tmp_path, rate=100.0)
    with pytest.raises(InputError, match="no such folder"):
        folder_frames(tmp_path / "g", rate=100.0)


def test_an_unreadable_file_in_a_folder_is_passed_on_with_its_name(tmp_path):
    folder = write_pictures(tmp_path / "f", ["a1.png", "a3.png"])
    (folder / "a2.png").write_bytes(b"half a picture")
    frames = list(folder_frames(folder, rate=100.0))
    assert [frame.picture is None for frame in frames] == [False, True, False]
    assert "a2.png" in frames[1].problem


def test_several_image_topics_must_be_told_apart(tmp_path):
    path = tmp_path / "x.mcap"
    with BagWriter(path) as bag:
        bag.write("/left/image", IMAGE, image(GREY, "mono8"), 1)
        bag.write("/right/image", IMAGE, image(GREY, "mono8"), 1)
    with pytest.raises(InputError, match=r"2 image topics \(/left/image, /right/image\)"), open_source(path):
        pass
    with open_source(path, topic="/right/image") as source:
        assert source.count == 1
        assert "not corrected" in source.problems[0]
