# SPDX-License-Identifier: Apache-2.0
"""The folder of one run: settings, journal, history, result, report and recording, and nothing outside it."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import yaml

from cwmav_common.cli import plain, to_json
from cwmav_common.errors import InputError
from cwmav_common.settings import read_yaml

_COLUMNS = {
    "F": "F_hz",
    "AoA": "AoA_deg",
    "U": "U_m_s",
    "lift_to_power": "lift_to_power_n_w",
    "evaluations": "solves",
}


@dataclass(frozen=True)
class RunFolder:
    """Paths and files of one run."""

    path: Path

    @classmethod
    def create(cls, root: str | Path, name: str, now: datetime | None = None) -> RunFolder:
        """Make ``root/<time>-<name>``; two runs in the same second get different folders."""
        stamp = (now or datetime.now()).strftime("%Y-%m-%dT%H-%M-%S")
        safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
        for attempt in range(1000):
            path = Path(root) / (f"{stamp}-{safe}" + (f"-{attempt + 1}" if attempt else ""))
            try:
                path.mkdir(parents=True)
            except FileExistsError:
                continue
            except OSError as error:
                raise InputError(f"{path}: the run folder cannot be made ({error})") from None
            return cls(path)
        raise InputError(f"{root}: no free name for a run folder at {stamp}")

    @classmethod
    def open(cls, path: str | Path) -> RunFolder:
        """Open an existing run folder."""
        folder = cls(Path(path))
        if not folder.config.is_file():
            raise InputError(f"{path}: is no run folder (it has no config.yaml)")
        return folder

    @classmethod
    def unfinished(cls, root: str | Path, problem_id: str) -> RunFolder:
        """Find the newest run of a problem that has a journal and no result.

        Raises
        ------
        InputError
            There is none.
        """
        for path in sorted(Path(root).glob("*"), reverse=True):
            folder = cls(path)
            if folder.result.exists() or not folder.journal.is_file() or not folder.config.is_file():
                continue
            if folder.read_config().get("problem", {}).get("id") == problem_id:
                return folder
        raise InputError(f"{root}: no unfinished run of '{problem_id}' to resume")

    @property
    def config(self) -> Path:
        """All settings, resolved."""
        return self.path / "config.yaml"

    @property
    def journal(self) -> Path:
        """Requests and answers."""
        return self.path / "journal" / "journal.jsonl"

    @property
    def result(self) -> Path:
        """The result; its presence says that the run came to its end."""
        return self.path / "result.json"

    @property
    def iterations(self) -> Path:
        """The history as a table."""
        return self.path / "iterations.csv"

    @property
    def report(self) -> Path:
        """The report, one self-contained HTML file."""
        return self.path / "report.html"

    @property
    def recording(self) -> Path:
        """Everything published, as MCAP."""
        return self.path / "run.mcap"

    def write_config(self, config: Mapping[str, Any]) -> None:
        """Write the resolved settings."""
        _replace(self.config, yaml.safe_dump(plain(config), sort_keys=False, allow_unicode=True))

    def read_config(self) -> dict[str, Any]:
        """Read the resolved settings."""
        return read_yaml(self.config)

    def write_result(self, result: Mapping[str, Any]) -> None:
        """Write the result, complete or not at all."""
        _replace(self.result, to_json(result) + "\n")

    def write_iterations(self, history: Sequence[Mapping[str, Any]]) -> None:
        """Write the history; called after every iteration, so a killed run leaves what it had."""
        if history:
            _replace(self.iterations, table_text(history))


def table_text(history: Sequence[Mapping[str, Any]]) -> str:
    """Render the history as CSV, nested values in columns of their own."""
    rows = [_flat(row) for row in history]
    columns = list(dict.fromkeys(key for row in rows for key in row))
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in plain(row).items():
        if isinstance(value, dict):
            flat |= {_COLUMNS.get(str(name), str(name)): item for name, item in value.items()}
        elif isinstance(value, list):
            flat |= {f"{key}_{index + 1}": item for index, item in enumerate(value)}
        else:
            flat[_COLUMNS.get(key, key)] = value
    return flat


def _replace(path: Path, text: str) -> None:
    """Write a file so that a reader, or a kill, never meets half of it."""
    temporary = path.with_name(path.name + ".part")
    with temporary.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)
