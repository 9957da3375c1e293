# SPDX-License-Identifier: Apache-2.0
"""The lens model against OpenCV's, and what it refuses."""

import cv2
import numpy as np
import pytest
import yaml

from cwmav_common import interfaces
from cwmav_common.errors import InputError
from cwmav_rig.angle.camera_model import PlainCamera, calibrated, from_camera_info, load_camera
from cwmav_rig.angle.frames import CAMERA_INFO

K = np.array([[705.0, 0, 322.5], [0, 698.0, 236.0], [0, 0, 1.0]])
PLUMB = [-0.28, 0.09, 0.0007, -0.0004, 0.01]
RATIONAL = [0.35, 0.12, 0.0003, -0.0002, 0.02, 0.7, 0.2, 0.03]
POINTS = np.random.default_rng(0).uniform([0, 0], [640, 480], (200, 2))


def camera(coefficients=PLUMB, model="plumb_bob", **changes):
    options = {"width": 640, "height": 480, "matrix": K, "model": model, "coefficients": coefficients}
    return calibrated(**{**options, **changes})


@pytest.mark.parametrize(("model", "coefficients"), [("plumb_bob", PLUMB), ("rational_polynomial", RATIONAL)])
def test_there_and_back_is_where_it_started(model, coefficients):
    lens = camera(coefficients, model)
    np.testing.assert_allclose(lens.recorded(lens.ideal(POINTS)), POINTS, atol=1e-8)


@pytest.mark.parametrize(("model", "coefficients"), [("plumb_bob", PLUMB), ("rational_polynomial", RATIONAL)])
def test_the_forward_model_is_opencvs(model, coefficients):
    lens = camera(coefficients, model)
    ideal = lens.ideal(POINTS)
    rays = np.column_stack([ideal / lens.focal, np.ones(len(ideal))])
    theirs, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, np.array(coefficients))
    np.testing.assert_allclose(theirs[:, 0], POINTS, atol=1e-6)


def test_rotation_turns_the_camera_as_rectification_does():
    turn, _ = cv2.Rodrigues(np.array([0.02, -0.03, 0.1]))
    lens = camera(rotation=turn)
    theirs = cv2.undistortPoints(POINTS[:, None], K, np.array(PLUMB), R=turn)[:, 0] * lens.focal
    np.testing.assert_allclose(lens.ideal(POINTS), theirs, atol=0.05)  # OpenCV stops after five iterations
    np.testing.assert_allclose(lens.recorded(lens.ideal(POINTS)), POINTS, atol=1e-8)


def test_a_camera_without_distortion_and_with_square_pixels_keeps_angles():
    matrix = np.diag([500.0, 500.0, 1.0])
    lens = camera([0] * 5, matrix=matrix)
    step = np.diff(lens.ideal(np.array([[10.0, 20.0], [110.0, 70.0]])), axis=0)[0]
    np.testing.assert_allclose(step, [100, 50], atol=1e-9)


def test_plain_camera_stretches_by_the_aspect_of_its_pixels():
    lens = PlainCamera(1.25)
    np.testing.assert_allclose(lens.ideal(POINTS)[:, 1], POINTS[:, 1] * 1.25)
    np.testing.assert_allclose(lens.recorded(lens.ideal(POINTS)), POINTS)


def test_binned_and_cut_pictures_see_the_same_rays():
    full = camera()
    half = camera(width=320, height=240, binning=(2, 2))
    pixel = np.array([[100.0, 80.0]])
    centre = 2 * (pixel + 0.5) - 0.5
    np.testing.assert_allclose(half.ideal(pixel) / half.focal, full.ideal(centre) / full.focal, atol=1e-12)
    cut = camera(width=200, height=100, offset=(50.0, 30.0))
    np.testing.assert_allclose(cut.ideal(pixel), full.ideal(pixel + np.array([50, 30])), atol=1e-12)


def test_outside_of_the_model_there_is_no_answer():
    wild = camera([-0.9, 0.0, 0, 0, 0], matrix=np.array([[200.0, 0, 320], [0, 200, 240], [0, 0, 1]]))
    assert np.isnan(wild.ideal(np.array([[0.0, 0.0]]))).all()
    assert np.isfinite(wild.ideal(np.array([[320.0, 250.0]]))).all()


def info(**changes):
    values = {
        "width": 640,
        "height": 480,
        "distortion_model": "plumb_bob",
        "d": PLUMB,
        "k": K.ravel(),
        "r": np.eye(3).ravel(),
        **changes,
    }
    return interfaces.new(CAMERA_INFO, **values)


def test_camera_info_gives_the_same_camera_as_its_numbers():
    lens = from_camera_info(info(), "here")
    np.testing.assert_allclose(lens.ideal(POINTS), camera().ideal(POINTS))


def test_camera_info_of_a_cut_sensor_knows_its_size():
    roi = interfaces.new("sensor_msgs/msg/RegionOfInterest", x_offset=100, y_offset=50, width=200, height=120)
    lens = from_camera_info(info(roi=roi, binning_x=2, binning_y=2), "here")
    assert (lens.width, lens.height) == (100, 60)
    np.testing.assert_allclose(lens.offset, [100, 50])


def test_zero_matrix_means_uncalibrated():
    assert from_camera_info(info(k=np.zeros(9)), "here") is None


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"distortion_model": "equidistant"}, "equidistant.*plumb_bob, rational_polynomial"),
        ({"d": RATIONAL}, "plumb_bob has 5 coefficients, 8 given"),
        ({"k": -K.ravel()}, "no camera"),
        ({"r": 2 * np.eye(3).ravel()}, "no rotation"),
        ({"d": [np.nan] * 5}, "no camera"),
    ],
)
def test_what_is_no_camera_is_refused_with_its_values(changes, text):
    with pytest.raises(InputError, match=text):
        from_camera_info(info(**changes), "/camera/camera_info")


def test_the_calibration_file_of_ros_is_read(tmp_path):
    path = tmp_path / "camera.yaml"
    block = {"rows": 3, "cols": 3, "data": K.ravel().tolist()}
    content = {
        "image_width": 640,
        "image_height": 480,
        "camera_name": "side",
        "camera_matrix": block,
        "distortion_model": "plumb_bob",
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": PLUMB},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": np.eye(3).ravel().tolist()},
    }
    path.write_text(yaml.safe_dump(content))
    np.testing.assert_allclose(load_camera(path).ideal(POINTS), camera().ideal(POINTS))
    del content["camera_matrix"]
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=r"camera\.yaml.*camera_matrix"):
        load_camera(path)
    with pytest.raises(InputError, match="none.yaml"):
        load_camera(tmp_path / "none.yaml")
