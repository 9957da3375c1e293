# SPDX-License-Identifier: Apache-2.0
"""The last result of every verification case, kept as data and as a table for people.

Both files are written by ``cwmav-sim verify --record FOLDER`` and never by hand. A case that runs again
replaces its own entry only, so long cases may be run one at a time.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numba

from cwmav_common.cli import to_json
from cwmav_common.errors import InputError
from cwmav_sim.fingerprint import coupled_fingerprint, solver_fingerprint
from cwmav_sim.verification.protocol import Check, VerificationCase

_DATA = "verification.json"
_TABLE = "verification.md"

_HEAD = """# Verification: last results

Written by `cwmav-sim verify --record docs/reference`; do not edit. Error and bar are in per cent of the
reference or, where that is zero, of the scale named with the quantity. `solver` is the fingerprint of the
numerics that ran, with the structure where there is one; the present ones are printed by
`cwmav-sim verify --list`. Cases marked *long* take more than two minutes on two cores (`make verify-long`).
"""


class Record:
    """Results in a folder, one entry per case.

    Parameters
    ----------
    folder : path
        Where ``verification.json`` and ``verification.md`` live.

    Raises
    ------
    InputError
        When the data cannot be read.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read()  # a damaged record is said before a long case runs, not after

    def _read(self) -> dict[str, Any]:
        path = self._folder / _DATA
        if not path.exists():
            return {}
        try:
            return dict(json.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: cannot be read ({error})") from None

    def add(self, case: VerificationCase, checks: Sequence[Check], seconds: float) -> None:
        """Replace the entry of a case and write both files; entries that others wrote meanwhile are kept."""
        entries = self._read()
        entries[case.name] = {
            "summary": case.summary,
            "long": case.slow,
            "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"),
            "commit": _commit(),
            "solver": coupled_fingerprint() if getattr(case, "flexible", False) else solver_fingerprint(),
            "machine": _machine(),
            "seconds": round(seconds, 1),
            "checks": json.loads(to_json([c.to_json() for c in checks])),
        }
        self._folder.mkdir(parents=True, exist_ok=True)
        from cwmav_sim.verification.catalogue import catalogue

        remarks = {c.name: getattr(c, "remark", "") for c in catalogue()}
        text = to_json(dict(sorted(entries.items()))) + "\n"
        (self._folder / _DATA).write_text(text, encoding="utf-8")
        (self._folder / _TABLE).write_text(table(entries, remarks), encoding="utf-8")


def table(entries: Mapping[str, Any], remarks: Mapping[str, str]) -> str:
    """Return the results as Markdown: a summary, then the checks of every case.

    The remark of a case is printed where a bar is missed: it says what is known of the cause.
    """
    rows = [
        "| case | result | date | commit | solver | time | machine |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    details: list[str] = []
    for name in sorted(entries):
        entry = entries[name]
        missed = [c for c in entry["checks"] if not c["passed"]]
        result = "all pass" if not missed else f"**{len(missed)} of {len(entry['checks'])} missed**"
        mark = " (long)" if entry["long"] else ""
        rows.append(
            f"| [{name}](#{name}){mark} | {result} | {entry['date']} | {entry['commit']} | {entry['solver']} "
            f"| {entry['seconds']:.0f} s | {entry['machine']} |"
        )
        details += ["", f"## {name}", "", f"{entry['summary'][:1].upper()}{entry['summary'][1:]}.", ""]
        details += [
            "| quantity | found | reference | error | bar | |",
            "| --- | --- | --- | --- | --- | --- |",
        ]
        for c in entry["checks"]:
            details.append(
                f"| {c['quantity']} | {_number(c['value'])} | {_number(c['reference'])} "
                f"| {_number(c['error_percent'])} % | {c['tolerance_percent']:g} % "
                f"| {'pass' if c['passed'] else '**missed**'} |"
            )
        sources = dict.fromkeys(c["source"] for c in entry["checks"])
        details += ["", f"Reference: {'; '.join(sources)}."]
        if missed:
            details += ["", f"Why: {remarks.get(name) or 'not known yet.'}"]
    return "\n".join([_HEAD, *rows, *details]) + "\n"


def _number(value: float | None) -> str:
    return "undefined" if value is None else f"{value:.5g}"


def _commit() -> str:
    """Short name of the commit, with a star where the checkout differs from it; a dash outside a checkout."""
    here = Path(__file__).parent
    try:
        name, changed = (
            subprocess.run(  # noqa: S603 - fixed commands
                command, cwd=here, capture_output=True, text=True, check=True
            ).stdout.strip()
            for command in (
                ("git", "rev-parse", "--short", "HEAD"),
                ("git", "status", "--porcelain", "--untracked-files=no", "--", str(here.parent)),
            )
        )
    except (OSError, subprocess.CalledProcessError):
        return "-"
    return name + ("*" if changed else "")


def _machine() -> str:
    """Processor, cores and threads in use."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [
            s.split(":", 1)[1].strip() for s in info.read_text().splitlines() if s.startswith("model name")
        ]
        model = names[0] if names else model
    return f"{model}, {os.cpu_count()} cores, {numba.get_num_threads()} threads"
