# SPDX-License-Identifier: Apache-2.0
"""Camera frames out of a folder of pictures, as high-speed cameras leave them."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cwmav_common.errors import InputError
from cwmav_rig.angle.frames import Frame, decode_bytes

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm")
TIMES = "times.csv"
_NUMBER = re.compile(r"(\d+)$")


def folder_frames(folder: str | Path, rate: float | None = None, start_ns: int = 0) -> Iterator[Frame]:
    """Read the pictures of a folder in the order of their numbers.

    Parameters
    ----------
    folder
        With pictures and, if the camera wrote one, ``times.csv`` with the columns ``file`` and ``stamp_ns``.
    rate
        Frames per second; needed without ``times.csv``. The number at the end of a name is then the frame
        counter, so that a missing picture leaves its gap in time.
    start_ns
        Time of the frame with the smallest number.

    Raises
    ------
    InputError
        No pictures, names without numbers, no times, or times of other files.
    """
    listed = list_pictures(folder)
    stamps = _stamps(Path(folder), listed, rate, start_ns)
    return _read(listed, stamps)


def list_pictures(folder: str | Path) -> list[tuple[int | None, Path]]:
    """Give (number at the end of the name, path) of the pictures, in order."""
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder")
    paths = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
    if not paths:
        raise InputError(f"{folder}: holds no pictures; read are {', '.join(SUFFIXES)}")
    numbered = [(_number(path), path) for path in paths]
    return sorted(numbered, key=lambda item: (-1 if item[0] is None else item[0], item[1].name))


def _number(path: Path) -> int | None:
    match = _NUMBER.search(path.stem)
    return int(match.group(1)) if match else None


def _read(listed: list[tuple[int | None, Path]], stamps: list[int]) -> Iterator[Frame]:
    for index, ((number, path), stamp_ns) in enumerate(zip(listed, stamps, strict=True)):
        try:
            picture = decode_bytes(np.fromfile(path, np.uint8), str(path))
            yield Frame(index, stamp_ns, picture, number, str(path))
        except (InputError, OSError) as error:
            yield Frame(index, stamp_ns, None, number, str(path), str(error))


def _stamps(
    folder: Path, listed: list[tuple[int | None, Path]], rate: float | None, start_ns: int
) -> list[int]:
    table = folder / TIMES
    if table.exists():
        return _from_table(table, [path.name for _, path in listed])
    if rate is None or not (np.isfinite(rate) and rate > 0):
        raise InputError(
            f"{folder}: has no {TIMES} (columns file, stamp_ns), so the frame rate must be given: "
            f"--rate above 0 Hz, got {rate}"
        )
    numbers = [number for number, _ in listed]
    unnumbered = [path.name for number, path in listed if number is None]
    if unnumbered or len(set(numbers)) < len(numbers):
        example = unnumbered[0] if unnumbered else "two files have the same number"
        raise InputError(f"{folder}: names must end in the frame number to give times by --rate ({example})")
    counted = [int(number) for number in numbers if number is not None]
    return [start_ns + round((number - counted[0]) * 1e9 / rate) for number in counted]


def _from_table(table: Path, names: list[str]) -> list[int]:
    try:
        with table.open(newline="", encoding="utf-8") as stream:
            stamps = {row["file"]: int(row["stamp_ns"]) for row in csv.DictReader(stream)}
    except (OSError, UnicodeDecodeError, csv.Error, KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"{table}: expected the columns file and stamp_ns (integer nanoseconds); "
            f"{type(error).__name__}: {error}"
        ) from None
    missing = [name for name in names if name not in stamps]
    if missing:
        raise InputError(f"{table}: no time for {missing[0]} ({len(missing)} of {len(names)} pictures)")
    return [stamps[name] for name in names]
