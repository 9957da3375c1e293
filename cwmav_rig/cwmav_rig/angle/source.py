# SPDX-License-Identifier: Apache-2.0
"""Where frames come from: a topic of a recording or a folder of pictures, with the lens."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from cwmav_common.errors import InputError
from cwmav_common.mcap_reader import Recording, open_recording
from cwmav_rig.angle.camera_model import CalibratedCamera, load_camera
from cwmav_rig.angle.folder import folder_frames, list_pictures
from cwmav_rig.angle.frames import Frame, bag_camera, bag_frames, image_topics
from cwmav_rig.topic_map import camera_info_beside


@dataclass(frozen=True)
class Source:
    """Frames ready to be read once.

    Attributes
    ----------
    frames
        The frames.
    count
        How many there should be.
    camera
        The lens; None when there is no calibration.
    name
        What is read, in words.
    problems
        Sentences on damage of the recording, and that there is no calibration.
    synthetic
        The frames are marked as coming from a simulated camera.
    """

    frames: Iterator[Frame]
    count: int
    camera: CalibratedCamera | None
    name: str
    problems: tuple[str, ...]
    synthetic: bool


def open_source(
    path: str | Path,
    *,
    topic: str = "",
    info_topic: str = "",
    camera: str | Path | None = None,
    rate: float | None = None,
) -> AbstractContextManager[Source]:
    """Open a recording (``.mcap`` or rosbag2 folder) or a folder of pictures.

    Parameters
    ----------
    topic
        Image topic; found when the recording has exactly one.
    info_topic
        CameraInfo topic; the one beside the image topic is taken when not given.
    camera
        Calibration file, instead of a CameraInfo topic.
    rate
        Frames per second of a folder without ``times.csv``.

    Raises
    ------
    InputError
        There is nothing to read, or what is there cannot be used.
    """
    path = Path(path)
    lens = load_camera(camera) if camera is not None else None
    if _is_picture_folder(path):
        if topic or info_topic:
            raise InputError(f"{path}: is a folder of pictures; it has no topic {topic or info_topic}")
        return nullcontext(_folder_source(path, lens, rate))
    return _bag_source(open_recording(path), topic, info_topic, lens)


def _is_picture_folder(path: Path) -> bool:
    return path.is_dir() and not (path / "metadata.yaml").exists() and not any(path.glob("*.mcap"))


def _folder_source(path: Path, lens: CalibratedCamera | None, rate: float | None) -> Source:
    frames = folder_frames(path, rate)
    synthetic = (path / "truth.csv").exists()
    return Source(frames, len(list_pictures(path)), lens, str(path), _no_lens(lens), synthetic)


@contextmanager
def _bag_source(
    recording: Recording, topic: str, info_topic: str, lens: CalibratedCamera | None
) -> Iterator[Source]:
    with recording:
        name = topic or _only_image_topic(recording)
        beside = info_topic or (camera_info_beside(recording, name) if lens is None else "")
        if lens is None and beside:
            lens = bag_camera(recording, beside)
        frames = bag_frames(recording, name, beside or None)
        synthetic = recording.metadata.get("cwmav_camera", {}).get("synthetic") == "true"
        problems = (*recording.problems, *_no_lens(lens))
        count = recording.topics[name].count
        yield Source(frames, count, lens, f"{recording.path}: {name}", problems, synthetic)


def _no_lens(lens: CalibratedCamera | None) -> tuple[str, ...]:
    return () if lens is not None else ("no camera calibration: distortion of the lens is not corrected",)


def _only_image_topic(recording: Recording) -> str:
    names = image_topics(recording)
    if len(names) != 1:
        raise InputError(
            f"{recording.path}: {len(names)} image topics ({', '.join(names) or 'none'}); "
            "name one with --topic"
        )
    return names[0]
