# SPDX-License-Identifier: Apache-2.0
"""A body with two marks and two flapping rods, at a known angle, as a real lens and sensor show it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_common.settings import setting
from cwmav_rig.angle.camera_model import CalibratedCamera, calibrated
from cwmav_rig.angle.synthetic_draw import SUBPIXELS, scene_light

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """What stands in front of the camera, in undistorted pixels and grey levels of an 8-bit camera."""

    width: int = setting(640, "columns of the picture", unit="px", ge=64, le=8192)
    height: int = setting(480, "rows of the picture", unit="px", ge=64, le=8192)
    nose: str = setting("right", "side the nose points to", choices=("left", "right"))
    body_length_px: float = setting(420.0, "length of the body", unit="px", gt=10)
    body_thickness_px: float = setting(36.0, "height of the body", unit="px", gt=4)
    background: float = setting(190.0, "grey level behind the body", ge=0, le=255)
    body: float = setting(60.0, "grey level of the body", ge=0, le=255)
    shading: float = setting(0.1, "relative fall of the light from left to right", ge=0, lt=1)
    markers: bool = setting(True, "two round marks on the body axis")
    marker_diameter_px: float = setting(16.0, "diameter of a mark", unit="px", gt=2)
    marker_distance_px: float = setting(300.0, "distance of the marks", unit="px", gt=4)
    marker: float = setting(210.0, "grey level of a mark", ge=0, le=255)
    rods: bool = setting(True, "two wing rods that flap across the picture")
    rod_sweep_deg: float = setting(37.5, "largest angle of a rod to the body", unit="deg", ge=0, le=80)


@dataclass(frozen=True)
class Optics:
    """What lens and sensor do to the picture."""

    k1: float = setting(0.0, "radial distortion coefficient (plumb_bob)")
    k2: float = setting(0.0, "second radial distortion coefficient")
    p1: float = setting(0.0, "tangential distortion coefficient")
    p2: float = setting(0.0, "second tangential distortion coefficient")
    focal_px: float = setting(700.0, "focal length", unit="px", gt=10)
    roll_deg: float = setting(0.0, "camera turned clockwise seen from behind", unit="deg", ge=-180, le=180)
    defocus_px: float = setting(0.7, "standard deviation of the blur of the lens", unit="px", ge=0, le=50)
    read_noise: float = setting(2.0, "standard deviation of the read-out noise", ge=0)
    shot_noise: float = setting(0.04, "variance of the noise per grey level", ge=0)
    exposure_gain: float = setting(1.0, "factor on all grey levels; above one pixels saturate", gt=0)


@dataclass(frozen=True)
class Pose:
    """Body at the middle of an exposure, and how far it goes during it.

    Attributes
    ----------
    angle
        Angle of attack [rad], mean over the exposure.
    x, y
        Middle of the body from the middle of the picture [px], mean over the exposure.
    sweep
        Rotation during the exposure [rad].
    drift
        Displacement during the exposure [px], (right, down).
    stroke
        Position of the rods, -1 to 1.
    """

    angle: float
    x: float = 0.0
    y: float = 0.0
    sweep: float = 0.0
    drift: tuple[float, float] = (0.0, 0.0)
    stroke: float = 0.0


def camera_of(scene: Scene, optics: Optics) -> CalibratedCamera | None:
    """Give the calibration that undoes the distortion; None for a lens without one."""
    if not any((optics.k1, optics.k2, optics.p1, optics.p2)):
        return None
    centre = ((scene.width - 1) / 2, (scene.height - 1) / 2)
    matrix = np.array([[optics.focal_px, 0, centre[0]], [0, optics.focal_px, centre[1]], [0, 0, 1.0]])
    return calibrated(
        width=scene.width,
        height=scene.height,
        matrix=matrix,
        model="plumb_bob",
        coefficients=[optics.k1, optics.k2, optics.p1, optics.p2, 0.0],
        source="synthetic camera",
    )


class Renderer:
    """Draws poses of one scene through one lens.

    Raises
    ------
    InputError
        The distortion folds back inside the picture, which no lens does.
    """

    def __init__(self, scene: Scene, optics: Optics) -> None:
        self.scene = scene
        self.optics = optics
        self.camera = camera_of(scene, optics)
        self._grid = _ideal_grid(scene, optics, self.camera)
        if not np.isfinite(self._grid).all():
            raise InputError(
                f"distortion k1={optics.k1:g} k2={optics.k2:g} p1={optics.p1:g} p2={optics.p2:g} with "
                f"focal length {optics.focal_px:g} px folds back inside the picture"
            )

    def draw(self, pose: Pose, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Draw one frame, (height, width)."""
        optics = self.optics
        light = self._light(pose) * optics.exposure_gain
        if optics.defocus_px > 0:
            light = np.asarray(cv2.GaussianBlur(light, (0, 0), optics.defocus_px), dtype=np.float64)
        noise = np.sqrt(optics.read_noise**2 + optics.shot_noise * np.maximum(light, 0.0))
        counts = light + noise * rng.standard_normal(light.shape)
        return np.asarray(np.clip(np.rint(counts), 0, 255).astype(np.uint8))

    def _light(self, pose: Pose) -> Array:
        scene = self.scene
        travel = abs(pose.sweep) * scene.body_length_px / 2 + float(np.hypot(*pose.drift))
        # Poses a quarter of a pixel apart at the most are a continuous smear to a sensor with pixels.
        count = 1 if travel == 0.0 else int(np.clip(np.ceil(4 * travel), 3, 100))
        moments = (np.arange(count) + 0.5) / count - 0.5
        angle = pose.angle + moments * pose.sweep
        poses = np.column_stack(
            [pose.x + moments * pose.drift[0], pose.y + moments * pose.drift[1], np.cos(angle), np.sin(angle)]
        )
        shape = np.array(
            [
                scene.body_length_px / 2,
                scene.body_thickness_px / 2,
                scene.marker_distance_px / 2,
                scene.marker_diameter_px / 2 if scene.markers else 0.0,
                0.45 * scene.body_length_px if scene.rods else 0.0,
                1.0 if scene.nose == "right" else -1.0,
                scene.width,
                scene.shading,
            ]
        )
        turn = np.pi / 2 + np.array([1.0, -1.0]) * pose.stroke * np.deg2rad(scene.rod_sweep_deg)
        rods = np.column_stack([np.cos(turn), np.sin(turn)])
        levels = np.array([scene.background, scene.body, scene.marker])
        return np.asarray(scene_light(self._grid, poses, shape, levels, rods, travel))


def _ideal_grid(scene: Scene, optics: Optics, camera: CalibratedCamera | None) -> Array:
    """Undistorted place of all sub-pixels from the optical axis, (rows, columns, SUBPIXELS, SUBPIXELS, 2)."""
    part = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
    u = np.arange(scene.width)[None, :, None, None] + part[None, None, None, :]
    v = np.arange(scene.height)[:, None, None, None] + part[None, None, :, None]
    u, v = np.broadcast_arrays(u, v)
    points = np.column_stack([u.ravel(), v.ravel()])
    ideal = points - np.array([(scene.width - 1) / 2, (scene.height - 1) / 2])
    if camera is not None:
        ideal = camera.ideal(points)
    roll = np.deg2rad(optics.roll_deg)
    # The scene seems turned counter-clockwise; what a pixel shows stands clockwise of it in the scene.
    x = ideal[:, 0] * np.cos(roll) - ideal[:, 1] * np.sin(roll)
    y = ideal[:, 0] * np.sin(roll) + ideal[:, 1] * np.cos(roll)
    return np.stack([x, y], axis=1).reshape(*u.shape, 2)
