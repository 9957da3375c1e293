# SPDX-License-Identifier: Apache-2.0
"""Small synthetic camera frames shared by the tests of the angle measurement."""

from dataclasses import replace

import numpy as np

from cwmav_rig.angle.frames import Frame
from cwmav_rig.angle.measure import measure_frame
from cwmav_rig.angle.settings import AngleSettings, Markers
from cwmav_rig.angle.synthetic import SyntheticCamera
from cwmav_rig.angle.synthetic_scene import Optics, Pose, Renderer, Scene

SCENE = Scene(
    width=320,
    height=240,
    body_length_px=210,
    body_thickness_px=26,
    marker_distance_px=150,
    marker_diameter_px=14,
)
EDGE = AngleSettings()
MARKERS = replace(EDGE, method="markers", markers=Markers(diameter_px=14))
DEVICE = SyntheticCamera(frames=20, scene=SCENE, heave_px=1.0)


def draw(pose, scene=SCENE, optics=None, seed=0):
    """Draw one frame."""
    optics = optics or Optics()
    return Frame(0, 1, Renderer(scene, optics).draw(pose, np.random.default_rng(seed)))


def measure(pose, settings=EDGE, scene=SCENE, optics=None, seed=0):
    """Draw and measure one frame."""
    optics = optics or Optics()
    renderer = Renderer(scene, optics)
    frame = Frame(0, 1, renderer.draw(pose, np.random.default_rng(seed)))
    return measure_frame(frame, settings, renderer.camera)


def trials(settings, optics, count, *, sweep=0.0, drift=(0.0, 0.0), seed=0):
    """Draw and measure `count` frames at random poses: errors and standard errors [deg], (count,) each."""
    renderer = Renderer(SCENE, optics)
    errors, stds = np.empty(count), np.empty(count)
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        angle = np.deg2rad(rng.uniform(-10, 60))
        pose = Pose(angle, *rng.uniform(-5, 5, 2), sweep, drift, rng.uniform(-1, 1))
        result = measure_frame(Frame(k, k, renderer.draw(pose, rng)), settings, renderer.camera)
        assert result.measured, result.text
        errors[k], stds[k] = np.rad2deg(result.angle - angle), np.rad2deg(result.std)
    return errors, stds
