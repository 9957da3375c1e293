# SPDX-License-Identifier: Apache-2.0
"""What another particle spacing changes: runs of two spacings at the same operating points, side by side."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from cwmav_common.errors import InputError
from cwmav_sim.table import TableRows, read_rows

_SMALL = 0.05  # N: below that a relative change says nothing
_BUNDLED = {
    "4 mm": "lift_4mm.csv",
    "6 mm": "lift_6mm.csv",
    "8 mm": "lift_table.csv",
    "12 mm": "lift_12mm.csv",
}


@dataclass(frozen=True)
class SpacingChange:
    """How lifts at one spacing differ from those at another.

    Attributes
    ----------
    dp, reference_dp : float
        The two spacings [m].
    points : int
        Shared operating points with more than 0.05 N.
    mean, std : float
        Mean of the relative changes and their standard deviation from point to point.
    """

    dp: float
    reference_dp: float
    points: int
    mean: float
    std: float

    def __str__(self) -> str:
        """Return the change as a sentence."""
        return (
            f"lifts at {1e3 * self.dp:g} mm differ from those at {1e3 * self.reference_dp:g} mm by "
            f"{100.0 * self.mean:+.1f} +- {100.0 * self.std:.1f} % ({self.points} points)"
        )


def change(rows: TableRows, reference: TableRows) -> SpacingChange:
    """Return the change from ``reference`` to ``rows`` over the operating points of both.

    Raises
    ------
    InputError
        For fewer than two shared points.
    """
    known = {tuple(point): lift for point, lift in zip(reference.points, reference.lift, strict=True)}
    pairs = [
        (lift, known[tuple(point)])
        for point, lift in zip(rows.points, rows.lift, strict=True)
        if abs(known.get(tuple(point), 0.0)) > _SMALL
    ]
    if len(pairs) < 2:
        raise InputError(f"spacings: {len(pairs)} shared points above {_SMALL} N; needed: at least 2")
    now, then = np.array(pairs).T
    relative = (now - then) / then
    return SpacingChange(
        rows.dp, reference.dp, len(pairs), float(relative.mean()), float(relative.std(ddof=1))
    )


def bundled(spacing: str) -> TableRows:
    """Return the bundled runs at 4 mm (preset ``fine``), 6 mm, 8 mm (the lift table) or 12 mm (``smoke``).

    Raises
    ------
    InputError
        For another spacing.
    """
    if spacing not in _BUNDLED:
        raise InputError(f"spacing '{spacing}' has no bundled runs; allowed: {', '.join(_BUNDLED)}")
    return read_rows(Path(str(resources.files("cwmav_sim") / "data" / _BUNDLED[spacing])))
