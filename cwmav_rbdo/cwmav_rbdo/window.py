# SPDX-License-Identifier: Apache-2.0
"""The moving search window around the current optimum (Eq. 11)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_common.settings import setting

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WindowSettings:
    """Size of the window."""

    q: float = setting(0.25, "scale factor q of the window (Eq. 11)", gt=0, le=1)
    rule: str = setting(
        "range",
        "range: q (dU - dL); sum: q (dL + dU) as Eq. 11 is printed",
        choices=("range", "sum"),
    )


SMALLEST, LARGEST = 0.05, 0.5
_GROWTH, _SHRINKAGE = 1.5, 0.7
_FAR = 0.25  # of the width of the window


@dataclass(frozen=True)
class Window:
    """An axis-parallel part of the design space, in the units of the problem."""

    lower: Array
    upper: Array


def adapted(settings: WindowSettings, moved: Array, window: Window) -> WindowSettings:
    """Let the window grow where the optimum still travels, and shrink where it has come to rest.

    Parameters
    ----------
    settings : with the present q
    moved : (d,) way of the optimum since the iteration before
    window : of the iteration before

    Returns
    -------
    WindowSettings
        With q within 0.05 and 0.5.
    """
    far = float(np.max(np.abs(moved) / (window.upper - window.lower))) > _FAR
    q = settings.q * (_GROWTH if far else _SHRINKAGE)
    return replace(settings, q=min(max(q, min(SMALLEST, settings.q)), max(LARGEST, settings.q)))


def moving_window(settings: WindowSettings, lower: Array, upper: Array, optimum: Array) -> Window:
    """Place the window around `optimum` and clip it to the design space.

    Parameters
    ----------
    settings : scale factor and rule
    lower, upper : (d,) bounds of the design space
    optimum : (d,) point inside the bounds

    Returns
    -------
    Window with ``lower < upper`` in every dimension.

    Raises
    ------
    InputError
        The rule gives a window without extent, as ``sum`` does where the bounds are symmetric about zero.

    Notes
    -----
    Eq. 11 is printed with the sum of the bounds, which depends on where zero lies on the scale (25 deg become
    12.5 deg for AoA, and a symmetric range gives no window at all); ``range`` is the reading that scales.
    """
    width = settings.q * (upper - lower if settings.rule == "range" else lower + upper)
    if np.any(width <= 0):
        bad = int(np.argmax(width <= 0))
        raise InputError(
            f"window: rule '{settings.rule}' gives the width {width[bad]:g} for the bounds "
            f"[{lower[bad]:g}, {upper[bad]:g}]; use rule 'range'"
        )
    return Window(
        np.maximum(lower, np.minimum(optimum - 0.5 * width, upper - 1e-9 * (upper - lower))),
        np.minimum(upper, np.maximum(optimum + 0.5 * width, lower + 1e-9 * (upper - lower))),
    )
