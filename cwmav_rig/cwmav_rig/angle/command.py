# SPDX-License-Identifier: Apache-2.0
"""``cwmav-rig angle`` and ``cwmav-rig synthesise-frames``."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from cwmav_common.cli import emit, message
from cwmav_common.errors import InputError
from cwmav_common.progress import progress
from cwmav_common.settings import from_mapping, load_yaml, override
from cwmav_rig.angle.settings import AngleSettings, Region
from cwmav_rig.topic_map import load_topic_map

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
Assign = Annotated[list[str] | None, typer.Option("--set", help="Any other setting, key=value.")]


def register(cli: typer.Typer) -> None:
    """Add the commands to a command group."""
    cli.command("angle")(angle)
    cli.command("synthesise-frames")(synthesise_frames)


def angle(
    source: Annotated[Path, typer.Argument(help="A recording (.mcap, rosbag2 folder) or a picture folder.")],
    topics: Annotated[
        Path | None, typer.Option(help="Topic map (YAML): angle_of_attack names it all.")
    ] = None,
    topic: Annotated[str, typer.Option(help="Image topic, when there are several.")] = "",
    camera_info: Annotated[str, typer.Option(help="CameraInfo topic, when it is not beside.")] = "",
    camera: Annotated[Path | None, typer.Option(help="Calibration file (YAML) instead.")] = None,
    settings: Annotated[Path | None, typer.Option(help="Settings of the measurement (YAML).")] = None,
    method: Annotated[str, typer.Option(help="edge or markers.")] = "",
    region: Annotated[tuple[int, int, int, int] | None, typer.Option(help="x y width height [px].")] = None,
    rate: Annotated[float | None, typer.Option(help="Frames per second of a picture folder.")] = None,
    assign: Assign = None,
    overlay: Annotated[Path | None, typer.Option(help="Folder for overlay pictures (PNG).")] = None,
    every: Annotated[int, typer.Option(help="Overlay of each n-th frame; refused ones always.", min=1)] = 1,
    out: Annotated[Path | None, typer.Option(help="Recording of angles and overlays (.mcap).")] = None,
    table: Annotated[Path | None, typer.Option(help="One line per frame (CSV).")] = None,
    as_json: Json = False,
) -> None:
    """Measure the angle of attack in camera frames, with its standard error frame by frame."""
    wanted = _wanted(topics, settings, topic, camera_info)
    if method:
        wanted = replace(wanted, settings=override(wanted.settings, [f"method={method}"], "--method"))
    if region is not None:
        keys = [f"region.{name}={value}" for name, value in zip(_REGION, region, strict=True)]
        wanted = replace(wanted, settings=override(wanted.settings, keys, "--region"))
    wanted = replace(wanted, settings=override(wanted.settings, assign or [], "--set"))
    result, lines = _measure(source, wanted, camera, rate, _Places(overlay, every, out, table))
    emit(result, as_json, lines)


_REGION = tuple(Region.__dataclass_fields__)


@dataclass(frozen=True)
class _Wanted:
    settings: AngleSettings
    topic: str
    info_topic: str


@dataclass(frozen=True)
class _Places:
    overlay: Path | None
    every: int
    out: Path | None
    table: Path | None


def _wanted(topics: Path | None, settings: Path | None, topic: str, info_topic: str) -> _Wanted:
    from cwmav_rig.angle.reader import role_settings

    if topics is None:
        return _Wanted(load_yaml(AngleSettings, settings) if settings else AngleSettings(), topic, info_topic)
    if settings is not None:
        raise InputError(f"{settings}: settings stand in the topic map {topics} under angle_of_attack.camera")
    role = load_topic_map(topics).angle_of_attack
    if not (topic or role.topic):
        raise InputError(f"{topics}: angle_of_attack names no topic")
    return _Wanted(role_settings(role, str(topics)), topic or role.topic, info_topic or role.camera_info)


def _measure(
    path: Path, wanted: _Wanted, camera: Path | None, rate: float | None, places: _Places
) -> tuple[dict[str, Any], list[str]]:
    from cwmav_rig.angle.source import open_source
    from cwmav_rig.angle.stream import measure_frames, stream_json
    from cwmav_rig.angle.write import Outputs, write_table

    source = open_source(path, topic=wanted.topic, info_topic=wanted.info_topic, camera=camera, rate=rate)
    with source as found:
        for problem in found.problems:
            message(problem)
        outputs = Outputs(
            wanted.settings, places.overlay, places.out, places.every, synthetic=found.synthetic
        )
        began = time.perf_counter()
        with outputs, progress(found.count, "frames", "frame") as bar:

            def on_frame(frame: Any, result: Any) -> None:
                outputs.take(frame, result)
                bar.update(1)

            stream = measure_frames(found.frames, wanted.settings, found.camera, on_frame)
        seconds = time.perf_counter() - began
    if places.table is not None:
        write_table(places.table, stream)
    for refusal in stream.refusals[:5]:
        message(f"frame {refusal.index} refused: {refusal.text}")
    if len(stream.refusals) > 5:
        message(f"... and {len(stream.refusals) - 5} more")
    statistics = stream.statistics(wanted.settings.quality.refused_fraction)
    speed = len(stream.angle) / seconds
    written = [str(p) for p in (places.overlay, places.out, places.table) if p is not None]
    result = {
        "source": found.name,
        "synthetic": found.synthetic,
        "method": wanted.settings.method,
        **stream_json(stream, statistics),
        "overlays": outputs.count,
        "frames_per_second": speed,
        "written": written,
        "problems": list(found.problems),
    }
    return result, _lines(result, speed)


def _lines(result: dict[str, Any], speed: float) -> list[str]:
    angle = result["angle_of_attack_deg"]
    refused = ", ".join(f"{count} {reason}" for reason, count in result["refused"].items()) or "none"
    lines = [
        f"{result['source']}: {'synthetic, ' if result['synthetic'] else ''}{result['frames']} frames at "
        f"{result['frame_rate_hz']:.4g} Hz, method {result['method']}",
        f"  AoA       {angle['mean']:.3f} deg   "
        f"scatter {angle['scatter']:.3f} deg, of the body {angle['motion']:.3f} deg",
        f"  error     {angle['frame_std']:.4f} deg per frame   "
        f"{angle['systematic_std']:.4f} deg common to all frames",
        f"  refused   {refused}",
        f"  missing   {result['dropped_frames']} frames in {len(result['gaps'])} gaps, "
        f"{result['repeated_frames']} repeated, {result['backward_frames']} out of order",
        f"  speed     {speed:.0f} frames/s",
    ]
    return lines + [f"  written   {name}" for name in result["written"]]


def synthesise_frames(
    out: Annotated[Path, typer.Option(help="An .mcap file, or a folder for PNG pictures.")],
    angle: Annotated[float, typer.Option("-A", help="Mean angle of attack [deg].")] = 15.0,
    frames: Annotated[int, typer.Option(help="Number of frames.")] = 200,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
    encoding: Annotated[str, typer.Option(help="mono8, rgb8, bgr8, png or jpeg, for .mcap.")] = "mono8",
    assign: Assign = None,
    as_json: Json = False,
) -> None:
    """Take frames with the simulated camera, marked synthetic, with their truth."""
    from cwmav_rig.angle.synthetic import SyntheticCamera, write_bag, write_folder

    values = {"angle_of_attack_deg": angle, "frames": frames, "seed": seed}
    device = override(from_mapping(SyntheticCamera, values, "synthesise-frames"), assign or [], "--set")
    with progress(frames, "drawing", "frame") as bar:
        if out.suffix == ".mcap":
            truth = write_bag(device, out, encoding, bar.update)
        else:
            truth = write_folder(device, out, bar.update)
    mean, scatter = float(np.rad2deg(truth.mean())), float(np.rad2deg(truth.std()))
    result = {
        "out": str(out),
        "synthetic": True,
        "frames": len(truth),
        "truth": {"mean_deg": mean, "scatter_deg": scatter, "angles_rad": truth},
    }
    emit(
        result,
        as_json,
        [
            f"{out}: synthetic, {len(truth)} frames, AoA {mean:.3f} deg, scatter {scatter:.3f} deg, "
            f"seed {seed}"
        ],
    )
