# SPDX-License-Identifier: Apache-2.0
"""Angles of drawn frames: sign, corrections, accuracy, honesty of the standard error, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from cwmav_common.errors import InputError
from cwmav_rig.angle.evidence import Reason
from cwmav_rig.angle.frames import Frame
from cwmav_rig.angle.measure import angle_of_attack, measure_frame
from cwmav_rig.angle.settings import AngleSettings, Finder, Quality, Region
from cwmav_rig.angle.synthetic_scene import Optics, Pose
from support.camera_frames import EDGE, MARKERS, SCENE, draw, measure, trials

METHODS = [pytest.param(EDGE, id="edge"), pytest.param(MARKERS, id="markers")]


def degrees(result):
    assert result.measured, result.text
    return np.rad2deg(result.angle)


def test_a_line_that_rises_towards_the_nose_is_nose_up():
    rising_to_the_right = -np.deg2rad(20.0)  # y points down
    assert np.rad2deg(angle_of_attack(rising_to_the_right, EDGE)) == pytest.approx(20)
    left = replace(EDGE, nose="left")
    assert np.rad2deg(angle_of_attack(rising_to_the_right, left)) == pytest.approx(-20)


@pytest.mark.parametrize("settings", METHODS)
@pytest.mark.parametrize("nose", ["left", "right"])
@pytest.mark.parametrize("angle", [-9.0, 0.0, 33.0, 58.0])
def test_nose_up_is_positive_whichever_way_the_nose_points(settings, nose, angle):
    result = measure(
        Pose(np.deg2rad(angle)), replace(settings, nose=nose), replace(SCENE, nose=nose), Optics(read_noise=1)
    )
    assert degrees(result) == pytest.approx(angle, abs=0.03)


@pytest.mark.parametrize("nose", ["left", "right"])
def test_the_roll_of_the_camera_is_taken_out(nose):
    scene, optics = replace(SCENE, nose=nose), Optics(roll_deg=4.0)
    pose = Pose(np.deg2rad(12.0))
    right = degrees(measure(pose, replace(EDGE, nose=nose, camera_roll_deg=4.0), scene, optics))
    blind = degrees(measure(pose, replace(EDGE, nose=nose), scene, optics))
    assert right == pytest.approx(12.0, abs=0.05)
    # The scene seems turned counter-clockwise: nose up for a nose at the right.
    assert blind - 12.0 == pytest.approx(4.0 if nose == "right" else -4.0, abs=0.05)


def test_the_angle_of_the_edge_to_the_axis_is_taken_out():
    settings = replace(EDGE, edge_to_axis_deg=2.5)
    assert degrees(measure(Pose(np.deg2rad(10.0)), settings)) == pytest.approx(7.5, abs=0.05)


@pytest.mark.parametrize("edge", ["upper", "lower", "strongest"])
@pytest.mark.parametrize("body", ["dark", "bright"])
def test_both_edges_of_dark_and_bright_bodies(edge, body):
    scene = SCENE if body == "dark" else replace(SCENE, background=50, body=180, marker=30)
    result = measure(Pose(np.deg2rad(25.0), stroke=0.4), replace(EDGE, edge=edge, body=body), scene)
    assert degrees(result) == pytest.approx(25.0, abs=0.05)
    if edge != "strongest":
        offsets = result.evidence.line.mean(axis=0)[1] - 119.5
        assert np.sign(offsets) == (-1 if edge == "upper" else 1)


def test_pixels_that_are_not_square():
    aspect = 1.3
    frame = draw(Pose(np.deg2rad(20.0)))
    narrow = Frame(0, 1, np.ascontiguousarray(frame.picture[::2]))  # every second row: pixels twice as high
    result = measure_frame(narrow, replace(EDGE, pixel_aspect=2.0))
    assert degrees(result) == pytest.approx(20.0, abs=0.1)
    wrong = measure_frame(frame, replace(EDGE, pixel_aspect=aspect))
    expected = np.rad2deg(np.arctan(np.tan(np.deg2rad(20.0)) * aspect))
    assert degrees(wrong) == pytest.approx(expected, abs=0.1)


def test_distortion_bends_the_edge_and_the_calibration_makes_it_straight():
    optics = Optics(k1=-0.3, k2=0.08, focal_px=300, read_noise=1)
    pose = Pose(np.deg2rad(15.0), y=-50.0)
    right = measure(pose, optics=optics)
    frame = draw(pose, optics=optics)
    blind = measure_frame(frame, EDGE)
    assert degrees(right) == pytest.approx(15.0, abs=0.03)
    assert right.evidence.scatter < 0.1
    assert not blind.measured or abs(np.rad2deg(blind.angle) - 15.0) > 0.1


def test_the_region_of_interest_keeps_other_edges_out():
    frame = draw(Pose(np.deg2rad(10.0)))
    picture = frame.picture.copy()
    picture[200:, :] = 10  # a table edge, longer and darker than the body
    cluttered = Frame(0, 1, picture)
    assert abs(np.rad2deg(measure_frame(cluttered, EDGE).angle)) < 1.0
    region = Region(0, 0, 320, 190)
    assert degrees(measure_frame(cluttered, replace(EDGE, region=region))) == pytest.approx(10.0, abs=0.05)


def test_other_angles_are_not_looked_for():
    frame = draw(Pose(np.deg2rad(10.0)))
    picture = frame.picture.copy()
    picture[200:, :] = 10
    limited = replace(EDGE, angle_min_deg=5.0, angle_max_deg=20.0)
    assert degrees(measure_frame(Frame(0, 1, picture), limited)) == pytest.approx(10.0, abs=0.05)


def test_sixteen_bit_frames_give_the_same_angle():
    frame = draw(Pose(np.deg2rad(18.0)))
    deep = Frame(0, 1, frame.picture.astype(np.uint16) * 16)
    a, b = measure_frame(frame, EDGE), measure_frame(deep, EDGE)
    assert a.angle == pytest.approx(b.angle, abs=1e-6)
    assert a.std == pytest.approx(b.std, rel=0.05)


@pytest.mark.parametrize(
    ("settings", "optics", "blur", "count"),
    [
        pytest.param(EDGE, Optics(read_noise=6), False, 200, id="edge-noise"),
        pytest.param(EDGE, Optics(read_noise=4, defocus_px=1.2), True, 200, id="edge-blur"),
        pytest.param(EDGE, Optics(k1=-0.25, k2=0.05, focal_px=300), False, 100, id="edge-lens"),
        pytest.param(MARKERS, Optics(read_noise=6), False, 100, id="markers-noise"),
        pytest.param(MARKERS, Optics(read_noise=4, defocus_px=1.2), True, 200, id="markers-blur"),
    ],
)
def test_angles_are_good_to_a_tenth_of_a_degree_and_say_how_good(settings, optics, blur, count):
    motion = {"sweep": 0.01, "drift": (2.0, 3.0)} if blur else {}
    errors, stds = trials(settings, optics, count, **motion)
    assert np.abs(errors).max() < 0.1
    assert abs(errors.mean()) < 0.02
    assert 0.90 <= np.mean(np.abs(errors) < 1.96 * stds) <= 0.99


def test_normals_close_together_do_not_make_the_standard_error_smaller():
    sparse = trials(EDGE, Optics(read_noise=6), 40)
    dense = trials(replace(EDGE, finder=Finder(spacing_px=1.0)), Optics(read_noise=6), 40)
    assert dense[1].mean() == pytest.approx(sparse[1].mean(), rel=0.35)
    assert np.mean(np.abs(dense[0]) < 1.96 * dense[1]) > 0.85


def test_the_same_frame_gives_the_same_bits():
    frame = draw(Pose(0.3))
    assert measure_frame(frame, EDGE).angle == measure_frame(frame, EDGE).angle
    assert np.array_equal(draw(Pose(0.3)).picture, frame.picture)
    assert not np.array_equal(draw(Pose(0.3), seed=1).picture, frame.picture)


def refused(result, reason, text):
    assert result.reason is reason
    assert text in result.text
    assert np.isnan(result.angle)
    assert np.isnan(result.std)


def test_saturated_frames():
    result = measure(Pose(0.2), optics=Optics(exposure_gain=1.6))
    refused(result, Reason.SATURATED, "at grey level 255")
    allowed = replace(EDGE, quality=Quality(saturated_fraction=1.0))
    assert measure(Pose(0.2), allowed, optics=Optics(exposure_gain=1.6)).measured


def test_a_twelve_bit_camera_saturates_at_its_own_level():
    deep = Frame(0, 1, np.minimum(draw(Pose(0.2)).picture.astype(np.uint16) * 25, 4095))
    assert measure_frame(deep, EDGE).measured
    known = replace(EDGE, quality=Quality(saturation_level=4095))
    refused(measure_frame(deep, known), Reason.SATURATED, "grey level 4095")


@pytest.mark.parametrize("settings", METHODS)
def test_blurred_frames(settings):
    limited = replace(settings, quality=Quality(blur_px=1.5))
    assert measure(Pose(0.2), limited, optics=Optics(defocus_px=0.7)).measured
    refused(measure(Pose(0.2), limited, optics=Optics(defocus_px=2.2)), Reason.BLURRED, "at most 1.5")


def test_faint_frames():
    faint = replace(SCENE, background=100, body=88, markers=False)
    refused(
        measure(Pose(0.2), scene=faint, optics=Optics(read_noise=3)), Reason.LOW_CONTRAST, "times the noise"
    )


def test_frames_without_the_body():
    empty = Frame(0, 1, np.random.default_rng(0).normal(120, 3, (240, 320)).astype(np.uint8))
    result = measure_frame(empty, EDGE)
    assert result.reason in (Reason.NO_EDGE, Reason.FEW_POINTS)
    even = measure_frame(Frame(0, 1, np.full((240, 320), 120, np.uint8)), EDGE)
    refused(even, Reason.NO_EDGE, "no upper edge of a dark body")


def test_short_bodies():
    short = replace(
        SCENE, body_length_px=60, marker_distance_px=30, body_thickness_px=16, markers=False, rods=False
    )
    few = measure(Pose(0.2), scene=short)
    refused(few, Reason.FEW_POINTS, "at least 25")
    patient = replace(EDGE, quality=Quality(points=6))
    refused(measure(Pose(0.2), patient, short), Reason.SHORT, "at least 60")


def test_bent_bodies():
    rows, columns = np.mgrid[0:240, 0:320]
    bent = 120 + 0.004 * (columns - 160.0) ** 2
    picture = np.where((rows > bent) & (rows < bent + 30) & (abs(columns - 160) < 120), 60.0, 190.0)
    noisy = picture + np.random.default_rng(0).normal(0, 2, picture.shape)
    result = measure_frame(Frame(0, 1, np.clip(noisy, 0, 255).astype(np.uint8)), EDGE)
    assert result.reason in (Reason.NOT_STRAIGHT, Reason.FEW_POINTS)


def test_marks_missing_or_too_many():
    bare = replace(SCENE, markers=False)
    refused(measure(Pose(0.2), MARKERS, bare), Reason.MARKERS, "0 bright marks of 14 px")
    frame = draw(Pose(0.0))
    picture = frame.picture.copy()
    rows, columns = np.mgrid[0:240, 0:320]
    picture[np.hypot(rows - 119.5, columns - 159.5) < 7] = 210
    refused(measure_frame(Frame(0, 1, picture), MARKERS), Reason.MARKERS, "3 bright marks")


def test_repeated_and_unreadable_frames():
    frame = draw(Pose(0.2))
    refused(measure_frame(frame, EDGE, previous=frame.picture), Reason.REPEATED, "pixel by pixel")
    assert measure_frame(
        frame, replace(EDGE, quality=Quality(identical=False)), previous=frame.picture
    ).measured
    broken = Frame(0, 1, None, problem="x.png: no readable picture")
    refused(measure_frame(broken, EDGE), Reason.UNREADABLE, "x.png")


def test_angles_out_of_range_and_uncertain_ones():
    steep = replace(EDGE, angle_max_deg=20.0)
    assert measure(Pose(np.deg2rad(40.0)), steep).reason is not None
    strict = replace(EDGE, quality=Quality(std_deg=1e-4))
    refused(measure(Pose(0.2), strict), Reason.UNCERTAIN, "at most 0.0001")


def test_settings_that_fit_no_picture_are_errors_not_refusals():
    with pytest.raises(InputError, match="pictures are 320 x 240"):
        measure(Pose(0.2), replace(EDGE, region=Region(300, 0, 100, 50)))
    with pytest.raises(InputError, match="not below"):
        AngleSettings(angle_min_deg=10, angle_max_deg=10)
    lens = Optics(k1=-0.1)
    small = Frame(0, 1, np.zeros((100, 100), np.uint8), name="frame 4")
    from cwmav_rig.angle.synthetic_scene import camera_of

    with pytest.raises(InputError, match=r"frame 4: picture is 100 x 100.*320 x 240"):
        measure_frame(small, EDGE, camera_of(SCENE, lens))
