# SPDX-License-Identifier: Apache-2.0
"""Many frames in, a stream of angles out: times, angles, standard errors, and every refusal counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import WorkError
from cwmav_rig.angle.camera_model import Camera
from cwmav_rig.angle.evidence import Reason
from cwmav_rig.angle.frames import Frame, Grey
from cwmav_rig.angle.measure import FrameAngle, measure_frame
from cwmav_rig.angle.settings import AngleSettings
from cwmav_rig.angle.timing import FrameTiming, frame_timing
from cwmav_rig.blocks import Series

Array = NDArray[np.float64]
QUALITIES = ("blur", "contrast", "noise", "scatter", "span", "correlation")


@dataclass(frozen=True)
class Refusal:
    """A frame that gave no angle."""

    index: int
    stamp_ns: int
    reason: str
    text: str


@dataclass(frozen=True)
class Statistics:
    """Angles of all measured frames together, rad.

    Attributes
    ----------
    mean
        Of the measured frames.
    scatter
        Standard deviation from frame to frame: motion of the body and error of measurement together.
    frame_std
        Root mean square of the frames' standard errors.
    motion
        Scatter without the error of measurement, ``sqrt(max(scatter^2 - frame_std^2, 0))``.
    systematic_std
        Standard uncertainty common to all frames: camera roll and edge angle.
    low, high
        Smallest and largest angle.
    """

    mean: float
    scatter: float
    frame_std: float
    motion: float
    systematic_std: float
    low: float
    high: float


@dataclass(frozen=True)
class AngleStream:
    """Angle of attack over time.

    Attributes
    ----------
    stamps_ns
        (n,) time of every frame [ns], refused ones included.
    angle, std
        (n,) angle of attack and standard error [rad]; NaN where refused.
    points
        (n,) edge points used.
    quality
        (n,) each: blur [px], contrast and noise [grey levels], scatter and span [px], correlation.
    refusals
        Of every refused frame.
    timing
        Dropped and repeated frames.
    systematic_std
        Standard uncertainty common to all frames [rad].
    """

    stamps_ns: NDArray[np.int64]
    angle: Array
    std: Array
    points: NDArray[np.int64]
    quality: Mapping[str, Array]
    refusals: tuple[Refusal, ...]
    timing: FrameTiming
    systematic_std: float

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(n,) true where there is an angle."""
        return np.isfinite(self.angle)

    @property
    def refused(self) -> dict[str, int]:
        """Number of refused frames by reason."""
        return dict(Counter(refusal.reason for refusal in self.refusals))

    def statistics(self, refused_fraction: float) -> Statistics:
        """Summarise the measured frames.

        Raises
        ------
        WorkError
            No frame gave an angle, or more than `refused_fraction` of them were refused.
        """
        good = self.measured
        count, total = int(good.sum()), len(good)
        reasons = ", ".join(f"{number} {reason}" for reason, number in self.refused.items())
        if not count or total - count > refused_fraction * total:
            first = f"; first: {self.refusals[0].text}" if self.refusals else ""
            raise WorkError(
                f"{total - count} of {total} frames refused ({reasons or 'no frames'}), at most "
                f"{100 * refused_fraction:g} % allowed{first}"
            )
        angles = self.angle[good]
        scatter = float(angles.std(ddof=1)) if count > 1 else float("nan")
        error = float(np.sqrt(np.mean(self.std[good] ** 2)))
        motion = float(np.sqrt(max(scatter**2 - error**2, 0.0))) if count > 1 else float("nan")
        return Statistics(
            mean=float(angles.mean()),
            scatter=scatter,
            frame_std=error,
            motion=motion,
            systematic_std=self.systematic_std,
            low=float(angles.min()),
            high=float(angles.max()),
        )


OnFrame = Callable[[Frame, FrameAngle], None]


def measure_frames(
    frames: Iterable[Frame],
    settings: AngleSettings,
    camera: Camera | None = None,
    on_frame: OnFrame | None = None,
) -> AngleStream:
    """Measure frame by frame; only two pictures are in memory at a time.

    Parameters
    ----------
    on_frame
        Called with every frame and its result, for overlays and progress.
    """
    collector = Collector(settings)
    for frame in frames:
        result = collector.take(frame, camera)
        if on_frame is not None:
            on_frame(frame, result)
    return collector.stream()


class Collector:
    """Measures frames and grows columns of results; pictures and points are let go.

    Parameters
    ----------
    settings
        Of the measurement.
    """

    def __init__(self, settings: AngleSettings) -> None:
        self.settings = settings
        self._previous: Grey | None = None
        self._stamps: list[int] = []
        self._numbers: list[int | None] = []
        self._rows: list[tuple[float, ...]] = []
        self._points: list[int] = []
        self._refusals: list[Refusal] = []

    def take(self, frame: Frame, camera: Camera | None) -> FrameAngle:
        """Measure one frame and keep its numbers."""
        result = measure_frame(frame, self.settings, camera, self._previous)
        if frame.picture is not None:
            self._previous = frame.picture
        evidence = result.evidence
        self._stamps.append(frame.stamp_ns)
        self._numbers.append(frame.number)
        qualities = [float(getattr(evidence, name)) if evidence else np.nan for name in QUALITIES]
        self._rows.append((result.angle, result.std, *qualities))
        self._points.append(int((evidence.weights > 0).sum()) if evidence else 0)
        if result.reason is not None:
            self._refusals.append(Refusal(result.index, result.stamp_ns, str(result.reason), result.text))
        return result

    def stream(self) -> AngleStream:
        """Give everything so far."""
        table = np.array(self._rows, dtype=float).reshape(-1, 2 + len(QUALITIES))
        stamps = np.array(self._stamps, dtype=np.int64)
        return AngleStream(
            stamps_ns=stamps,
            angle=table[:, 0],
            std=table[:, 1],
            points=np.array(self._points, dtype=np.int64),
            quality={name: table[:, 2 + k] for k, name in enumerate(QUALITIES)},
            refusals=tuple(self._refusals),
            timing=frame_timing(stamps, self._numbers),
            systematic_std=self.settings.systematic_std,
        )


def as_series(stream: AngleStream, origin_ns: int) -> Series:
    """Turn the measured frames into the series that other angle sources give, times [s] from `origin_ns`.

    Refused and missing frames are counted as bad, repeated ones only as faults: nothing is lost with them.
    """
    good = stream.measured
    seconds = (stream.stamps_ns[good] - origin_ns).astype(np.float64) * 1e-9
    order = np.argsort(seconds, kind="stable")
    faults: Counter[str] = Counter(stream.refused)
    repeated = faults.get(Reason.REPEATED, 0)
    faults.update(missing=stream.timing.dropped, out_of_order=stream.timing.backwards)
    bad = len(stream.refusals) - repeated + stream.timing.dropped
    return Series(seconds[order], stream.angle[good][order], int(good.sum()) + bad, bad, +faults)


def stream_json(stream: AngleStream, statistics: Statistics) -> dict[str, Any]:
    """Give the result as the command prints it; degrees for people."""
    degrees = {f"{name}_deg": np.rad2deg(value) for name, value in vars(statistics).items()}
    timing = stream.timing
    return {
        "frames": len(stream.angle),
        "measured": int(stream.measured.sum()),
        "refused": stream.refused,
        "refused_frames": [vars(refusal) for refusal in stream.refusals],
        "angle_of_attack_deg": {name.removesuffix("_deg"): float(value) for name, value in degrees.items()},
        "frame_rate_hz": timing.rate,
        "frame_jitter_s": timing.jitter,
        "dropped_frames": timing.dropped,
        "gaps": [{"before_frame": index, "missing": number} for index, number in timing.gaps],
        "repeated_frames": timing.repeated,
        "backward_frames": timing.backwards,
        "quality": {
            name: float(np.nanmedian(values)) if np.isfinite(values).any() else None
            for name, values in stream.quality.items()
        },
    }
