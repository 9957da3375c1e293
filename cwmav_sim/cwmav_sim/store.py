# SPDX-License-Identifier: Apache-2.0
"""Results kept by content: nothing is computed twice, and no stale number is served.

The address of a case is a hash of all its settings and of the solver's source, so a change of either
misses the store instead of finding an old result.
"""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

from cwmav_common.cli import to_json
from cwmav_common.errors import InputError, WorkError
from cwmav_common.settings import to_mapping
from cwmav_sim.case import Case, from_dict
from cwmav_sim.result import LiftResult


class ResultStore:
    """A folder of results, one JSON file per case.

    Parameters
    ----------
    path : path
        The folder; made when the first result is put.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def get(self, case: Case) -> LiftResult | None:
        """Return the result of a case, or None when there is none of this solver.

        Raises
        ------
        InputError
            When the stored file is damaged.
        """
        path = self._file(case.address())
        if not path.exists():
            return None
        return LiftResult.from_json(_read(path).get("result", {}), str(path))

    def put(self, case: Case, result: LiftResult) -> Path:
        """Keep a result with its case; the file appears whole or not at all.

        Raises
        ------
        WorkError
            When the folder cannot be written.
        """
        path = self._file(case.address())
        content = {"case": to_mapping(case), "result": result.to_json()}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(to_json(content))
            Path(temporary).replace(path)
        except OSError as error:
            raise WorkError(f"{path}: the result cannot be stored ({error})") from None
        return path

    def everything(self, solver: str | None = None) -> list[LiftResult]:
        """Return all results of one solver, in the order F, AoA, U.

        Parameters
        ----------
        solver : str, optional
            Fingerprint of the solver that made them; by default this one.

        Raises
        ------
        InputError
            When a file is damaged, was made by another solver, or does not hold the case its name says; such
            rows must not slip into a table unseen.
        """
        found = [self._checked(path, solver) for path in sorted(self.path.rglob("*.json"))]
        return sorted(found, key=lambda r: (r.flapping_frequency, r.angle_of_attack_deg, r.airspeed))

    def _checked(self, path: Path, solver: str | None) -> LiftResult:
        content = _read(path)
        result = LiftResult.from_json(content.get("result", {}), str(path))
        case = from_dict(content.get("case", {}), str(path))
        made_by, wanted = result.provenance.solver, solver or case.solver
        if made_by != wanted:
            raise InputError(f"{path}: made by solver {made_by}; allowed: {wanted}")
        address = case.address(wanted)
        if not address == result.address == path.stem:
            raise InputError(f"{path}: holds the result of case {result.address}, its settings are {address}")
        return result

    def _file(self, address: str) -> Path:
        return self.path / address[:2] / f"{address}.json"


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is no stored result ({error}); delete it to compute again") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: is not a stored result (no keys and values)")
    return content
