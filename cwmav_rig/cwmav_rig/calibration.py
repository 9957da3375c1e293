# SPDX-License-Identifier: Apache-2.0
"""Zero of the force sensor and its attitude, from wind-off runs.

At rest in still air the sensor feels the weight W of what hangs on it and its own zero b. With the pitch p
of the sensor to the body (nose up) and the angle of attack a

    Fx = bx - W sin(a + p),    Fz = bz - W cos(a + p),

x forward and z up in the axes of the sensor. Runs at one attitude give b and W together, which is all that
a flapping run at the same attitude needs. Runs at two attitudes or more tell them apart by least squares in
(bx, bz, W cos p, W sin p), and so serve every attitude; runs at different times also give the drift of the
zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAME_ATTITUDE = np.radians(1.0)  # a weight of 0.17 N changes its components by 3 mN within it
LARGEST_RESIDUAL = 3e-3  # N, rms of wind-off runs about the straight drift or the turned weight


@dataclass(frozen=True)
class TareRun:
    """One wind-off run.

    Attributes
    ----------
    time
        Middle of the run [s] from the origin of the flapping run.
    angle
        Angle of attack [rad]; None when not recorded, which means that of the flapping run.
    wrench
        (6,) mean force [N] and moment [N m].
    std
        (6,) standard uncertainty of that mean from the scatter of the samples.
    temperature
        Of the sensor [deg C]; None where that of the flapping run at `time` is to be taken.
    """

    time: float
    wrench: Array
    angle: float | None = None
    std: Array | None = None
    source: str = ""
    temperature: float | None = None


@dataclass(frozen=True)
class Zero:
    """What has to be taken off the force of a flapping run.

    Attributes
    ----------
    at_begin, at_end, begin, end
        (6,) wrench at two times [s]; straight between and constant outside.
    std
        (6,) standard uncertainty from the scatter of the wind-off runs.
    drift
        (3,) change of the zero force over the flapping run [N]; NaN when it cannot be told.
    pitch, pitch_std
        Pitch of the sensor to the body [rad] by the turned weight; None with one attitude only.
    weight
        Weight on the sensor [N]; None with one attitude only.
    """

    at_begin: Array
    at_end: Array
    begin: float
    end: float
    std: Array
    drift: Array
    attitudes: int
    runs: int
    pitch: float | None = None
    pitch_std: float | None = None
    weight: float | None = None

    def at(self, time: Array) -> Array:
        """Wrench at `time` (n,), (n, 6)."""
        if self.end <= self.begin:
            return np.tile(self.at_begin, (len(time), 1))
        share = np.clip((time - self.begin) / (self.end - self.begin), 0.0, 1.0)[:, None]
        return np.asarray((1.0 - share) * self.at_begin + share * self.at_end)


class TareError(ValueError):
    """The wind-off runs do not serve the flapping run; says why."""


def zero_for(
    runs: Sequence[TareRun],
    angle: float | None,
    span: tuple[float, float],
    forward: str = "x",
    upward: str = "z",
) -> Zero:
    """Find the zero for a flapping run.

    Parameters
    ----------
    angle
        Mean angle of attack of the flapping run [rad]; None when not recorded.
    span
        Begin and end [s] of the flapping run.
    forward, upward
        Axes of the sensor that point forward and up at zero angle of attack, such as ``-x``.

    Raises
    ------
    TareError
        No run at the attitude of the flapping run and too few attitudes to turn the weight, or the runs
        contradict each other.
    """
    fitting = [run for run in runs if _same(run.angle, angle)]
    attitudes = _attitudes(runs)
    if len(attitudes) > 1:
        return _turned(runs, angle, span, forward, upward, len(attitudes))
    if not fitting:
        had = ", ".join(f"{np.degrees(value):.1f}" for value in attitudes)
        raise TareError(
            f"the wind-off runs stand at {had} deg and the wings beat at {np.degrees(angle or 0.0):.1f} deg;"
            f" needed: one within {np.degrees(SAME_ATTITUDE):g} deg, or two attitudes or more"
        )
    return _straight(fitting, span, len(attitudes))


def _same(run: float | None, angle: float | None) -> bool:
    return run is None or angle is None or abs(run - angle) <= SAME_ATTITUDE


def _attitudes(runs: Sequence[TareRun]) -> list[float]:
    """Angles of the runs [rad], those that agree counted once."""
    found: list[float] = []
    for value in sorted(run.angle for run in runs if run.angle is not None):
        if not found or value - found[-1] > SAME_ATTITUDE:
            found.append(value)
    return found


def _straight(runs: Sequence[TareRun], span: tuple[float, float], attitudes: int) -> Zero:
    """Straight line through runs at the attitude itself."""
    order = sorted(runs, key=lambda run: run.time)
    time = np.array([run.time for run in order])
    values = np.stack([run.wrench for run in order])
    std = _combined_std(order)
    if len(order) == 1 or np.ptp(time) == 0.0:
        mean = values.mean(axis=0)
        return Zero(mean, mean, *span, std, np.full(3, np.nan), attitudes, len(order))
    if len(order) == 2:
        # Before and after: no extrapolation beyond the two.
        slope = (values[1] - values[0]) / (time[1] - time[0])
        begin, end = float(time[0]), float(time[1])
        return Zero(values[0], values[1], begin, end, std, slope[:3] * (span[1] - span[0]), attitudes, 2)
    slope, start = np.polyfit(time, values, 1)
    left = values - start - np.outer(time, slope)
    _refuse_scatter(
        float(np.sqrt((left[:, :3] ** 2).sum(axis=0).max() / (len(order) - 2))), "a straight drift"
    )
    first, last = float(time[0]), float(time[-1])
    drift = slope[:3] * (span[1] - span[0])
    return Zero(start + first * slope, start + last * slope, first, last, std, drift, attitudes, len(order))


def _turned(
    runs: Sequence[TareRun],
    angle: float | None,
    span: tuple[float, float],
    forward: str,
    upward: str,
    attitudes: int,
) -> Zero:
    """Least squares for zero, drift and turned weight, over runs whose attitude is known."""
    if angle is None:
        raise TareError("wind-off runs at several attitudes need the angle of attack of the flapping run")
    known = [run for run in runs if run.angle is not None]
    time = np.array([run.time for run in known])
    a = np.array([run.angle for run in known], float)
    wrench = np.stack([run.wrench for run in known])
    sine, cosine, one, none = np.sin(a), np.cos(a), np.ones(len(a)), np.zeros(len(a))
    middle = 0.5 * (span[0] + span[1])
    columns = [
        np.concatenate((one, none)),
        np.concatenate((none, one)),
        np.concatenate((-sine, -cosine)),  # W cos p
        np.concatenate((-cosine, sine)),  # W sin p
    ]
    drifting = _repeated(known) and np.ptp(time) > 0.0 and len(known) > attitudes
    if drifting:
        columns += [np.concatenate((time - middle, none)), np.concatenate((none, time - middle))]
    design = np.stack(columns, axis=1)
    (x, x_sign), (z, z_sign) = _column(forward), _column(upward)
    seen = np.concatenate((x_sign * wrench[:, x], z_sign * wrench[:, z]))
    solution, _, rank, _ = np.linalg.lstsq(design, seen, rcond=None)
    if rank < design.shape[1]:
        raise TareError("the wind-off runs do not tell zero and weight apart; add one at another attitude")
    left = seen - design @ solution
    freedom = len(seen) - design.shape[1]
    sigma = float(np.sqrt((left**2).sum() / freedom)) if freedom > 0 else float("nan")
    if freedom > 0:
        _refuse_scatter(sigma, "a weight that turns with the angle of attack")
    noise = max(np.nan_to_num(sigma), float(_combined_std(known)[:3].max()) * np.sqrt(len(known)))
    covariance = np.linalg.inv(design.T @ design) * noise**2
    weight = float(np.hypot(solution[2], solution[3]))
    pitch = float(np.arctan2(solution[3], solution[2]))
    turn = np.array([-np.sin(pitch), np.cos(pitch)]) / max(weight, 1e-12)  # of p with (W cos p, W sin p)
    pitch_std = float(np.sqrt(turn @ covariance[2:4, 2:4] @ turn))
    nearest = min(known, key=lambda run: abs(float(run.angle or 0.0) - angle))
    rates = solution[4:6] if drifting else np.zeros(2)
    at = {}
    for end in span:
        value = nearest.wrench.copy()
        later = end - middle
        value[x] = x_sign * (solution[0] - weight * np.sin(angle + pitch) + rates[0] * later)
        value[z] = z_sign * (solution[1] - weight * np.cos(angle + pitch) + rates[1] * later)
        at[end] = value
    std = _combined_std([nearest])
    for column, rows in (
        (x, (1.0, 0.0, -np.sin(angle), -np.cos(angle))),
        (z, (0.0, 1.0, -np.cos(angle), np.sin(angle))),
    ):
        row = np.array(rows)
        std[column] = np.sqrt(row @ covariance[:4, :4] @ row)
    drift = np.full(3, np.nan)
    if drifting:
        drift[x], drift[z] = rates * (span[1] - span[0])
    return Zero(at[span[0]], at[span[1]], *span, std, drift, attitudes, len(known), pitch, pitch_std, weight)


def _column(axis: str) -> tuple[int, float]:
    return "xyz".index(axis[-1]), -1.0 if axis.startswith("-") else 1.0


def _repeated(runs: Sequence[TareRun]) -> bool:
    return len(runs) > len(_attitudes(runs))


def _combined_std(runs: Sequence[TareRun]) -> Array:
    """Give the standard uncertainty (6,) of the mean of runs from their samples; zero where unknown."""
    variances = [np.zeros(6) if run.std is None else np.asarray(run.std, float) ** 2 for run in runs]
    return np.asarray(np.sqrt(np.sum(variances, axis=0)) / len(runs))


def _refuse_scatter(rms: float, model: str) -> None:
    if rms > LARGEST_RESIDUAL:
        raise TareError(
            f"the wind-off runs scatter by {rms * 1e3:.1f} mN about {model};"
            f" at most {LARGEST_RESIDUAL * 1e3:g} mN is allowed"
        )
