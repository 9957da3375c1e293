# SPDX-License-Identifier: Apache-2.0
"""What is read from a run: forces against time, cycle means, their uncertainty, and periodicity.

Lift is the force of the air on all wings normal to the wind (z of the wind frame), drag the force along
the wind (x). Both are the sum of the pressure and the viscous reaction of the particles; no filter is
applied. A half model counts twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwmav_common.errors import InputError
from cwmav_sim.wing.sheet import FloatArray

_BINS = 64  # phase bins of a cycle for averages; a flapping cycle has little content above 20 harmonics


@dataclass(frozen=True)
class History:
    """Forces of the air on each panel against time.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Instants [s], increasing.
    pressure, viscous : ndarray, shape (n, p, 3)
        Force on each panel in the wind frame [N].
    power : ndarray, shape (n, p)
        Power the panel gives to the air, minus the sum of force times velocity [W].
    copies : int
        2 for a half model, 1 for a full one: how often the panels count.
    moment : ndarray, shape (n, p, 3)
        Moment of the air on each panel about the origin, the front of the hinge axis [N m].
    inertial : ndarray, shape (n, p, 3)
        Force of inertia of each panel, minus its rate of change of momentum [N]. With the force of the air it
        is what the panel exerts on its hinge.
    """

    time: FloatArray
    pressure: FloatArray
    viscous: FloatArray
    power: FloatArray
    copies: int
    moment: FloatArray
    inertial: FloatArray

    def total(self) -> FloatArray:
        """Return the force on the whole vehicle [N], shape (n, 3); sideways forces cancel in a half model."""
        return self.part(self.pressure + self.viscous)

    def lift(self) -> FloatArray:
        """Return the lift [N], shape (n,)."""
        lift: FloatArray = self.total()[:, 2]
        return lift

    def drag(self) -> FloatArray:
        """Return the drag [N], shape (n,); negative when the wings drive the vehicle forward."""
        drag: FloatArray = self.total()[:, 0]
        return drag

    def part(self, force: FloatArray) -> FloatArray:
        """Return one of the forces for the whole vehicle [N], shape (n, 3)."""
        total: FloatArray = self.copies * force.sum(axis=1)
        if self.copies == 2:
            total[:, 1] = 0.0
        return total

    def pitch_moment(self) -> FloatArray:
        """Return the moment about y through the origin, nose up positive [N m], shape (n,)."""
        moment: FloatArray = self.copies * self.moment[:, :, 1].sum(axis=1)
        return moment

    def total_power(self) -> FloatArray:
        """Return the power given to the air by all wings [W], shape (n,)."""
        power: FloatArray = self.copies * self.power.sum(axis=1)
        return power


class Recorder:
    """Collects the history of a run, one row per step."""

    def __init__(self, panels: int, copies: int) -> None:
        self._panels, self._copies = panels, copies
        self._rows: list[tuple[float, FloatArray]] = []

    def add(
        self,
        time: float,
        pressure: FloatArray,
        viscous: FloatArray,
        power: FloatArray,
        moment: FloatArray,
        inertial: FloatArray,
    ) -> None:
        """Append one instant; arrays of shape (p,) for the power and (p, 3) for the rest are copied."""
        parts = (pressure, viscous, moment, inertial, np.asarray(power)[:, None])
        self._rows.append((time, np.concatenate(parts, axis=1)))

    def rows(self) -> tuple[FloatArray, FloatArray]:
        """Return the instants (n,) and what was recorded at them, shape (n, p, 13)."""
        if not self._rows:
            return np.zeros(0), np.zeros((0, self._panels, 13))
        time, values = zip(*self._rows, strict=True)
        return np.array(time), np.array(values)

    def refill(self, time: FloatArray, values: FloatArray) -> None:
        """Take over the rows of another recorder."""
        self._rows = [(float(t), row) for t, row in zip(time, values, strict=True)]

    def history(self) -> History:
        """Return what was recorded so far."""
        time, values = self.rows()
        pressure, viscous, moment, inertial = (values[:, :, 3 * k : 3 * k + 3] for k in range(4))
        return History(time, pressure, viscous, values[:, :, 12], self._copies, moment, inertial)


def phase_bins(time: FloatArray, signal: FloatArray, frequency: float, bins: int = _BINS) -> FloatArray:
    """Average a signal over equal parts of each complete cycle.

    The signal is integrated by the trapezoidal rule between its own, unequal instants, so that no weight
    is lost at the borders of a cycle.

    Parameters
    ----------
    time, signal : ndarray, shape (n,)
        Instants [s] and values; cycle k runs from k/F to (k+1)/F.
    frequency : float
        Flapping frequency F [Hz].
    bins : int
        Parts of a cycle.

    Returns
    -------
    ndarray, shape (cycles, bins)
        Means of every part of the complete cycles since time zero.
    """
    if len(time) < 2:
        return np.zeros((0, bins))
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (signal[1:] + signal[:-1]) * np.diff(time))])
    # A record that starts one step after zero, or ends one step early, still holds its cycle.
    slack = 2.0 * float(np.max(np.diff(time)))
    cycles = int(np.floor((time[-1] + slack) * frequency))
    edges = np.arange(cycles * bins + 1) / (bins * frequency)
    width = np.diff(np.clip(edges, time[0], time[-1]))
    if np.any(width <= 0):
        raise InputError(f"history: {len(time)} instants are too few for {cycles} cycles of {bins} parts")
    means: FloatArray = np.diff(_integral_at(edges, time, signal, integral)) / width
    return means.reshape(cycles, bins)


def _integral_at(edges: FloatArray, time: FloatArray, signal: FloatArray, integral: FloatArray) -> FloatArray:
    """Integral of the piecewise linear signal up to each edge."""
    inside = np.clip(edges, time[0], time[-1])
    k = np.clip(np.searchsorted(time, inside, side="right") - 1, 0, len(time) - 2)
    span = inside - time[k]
    slope = (signal[k + 1] - signal[k]) / (time[k + 1] - time[k])
    out: FloatArray = integral[k] + signal[k] * span + 0.5 * slope * span**2
    return out


@dataclass(frozen=True)
class CycleMean:
    """Mean of a signal over whole cycles, and its standard uncertainty."""

    mean: float
    std: float
    per_cycle: tuple[float, ...]


def cycle_mean(binned: FloatArray, discard: int) -> CycleMean:
    """Average over the cycles after the first ``discard``, with a correlation-aware uncertainty.

    Parameters
    ----------
    binned : ndarray, shape (cycles, bins)
        From :func:`phase_bins`.
    discard : int
        Leading cycles left out of the mean.

    Returns
    -------
    CycleMean
        ``per_cycle`` holds the means of all cycles, the discarded ones too; ``std`` is NaN when fewer
        than two cycles are kept.
    """
    kept = binned[discard:]
    if len(kept) == 0:
        raise InputError(f"history: {len(binned)} complete cycles; needed: more than the {discard} discarded")
    per_cycle = tuple(float(m) for m in binned.mean(axis=1))
    return CycleMean(float(kept.mean()), mean_uncertainty(kept), per_cycle)


def mean_uncertainty(binned: FloatArray) -> float:
    """Return the standard uncertainty of the mean of a cyclic signal.

    What repeats in every cycle is no uncertainty: the phase average is taken out, and the long-run
    variance of what is left is summed over lags below one cycle with Bartlett weights (Newey & West,
    Econometrica 55, 1987). The phase average was estimated from the same n cycles, hence n/(n - 1).
    Fluctuations slower than a cycle escape those lags, so the scatter of the cycle means is taken where
    it is larger. The result knows nothing of the error of spacing, box or wing model.

    Parameters
    ----------
    binned : ndarray, shape (n, bins)
        Cycles kept.

    Returns
    -------
    float
        Standard uncertainty, NaN for fewer than two cycles.
    """
    cycles, bins = binned.shape
    if cycles < 2:
        return float("nan")
    residual = (binned - binned.mean(axis=0)).ravel()
    covariance = np.correlate(residual, residual, mode="full")[residual.size - 1 :] / residual.size
    lags = np.arange(1, bins)
    long_run = covariance[0] + 2.0 * np.sum((1.0 - lags / bins) * covariance[lags])
    within = max(long_run, 0.0) * cycles / (cycles - 1) / residual.size
    between = float(np.var(binned.mean(axis=1), ddof=1)) / cycles
    return float(np.sqrt(max(within, between)))


def is_periodic(lift: FloatArray, drag: FloatArray, tolerance: float) -> bool:
    """Tell whether the last two cycle means of lift agree.

    Their difference is compared with ``tolerance`` times the mean resultant force of the last cycle,
    which stays meaningful when the lift itself passes through zero.

    Parameters
    ----------
    lift, drag : ndarray, shape (cycles, bins)
        From :func:`phase_bins`.
    tolerance : float
        Largest allowed change, for example 0.02.
    """
    if len(lift) < 2:
        return False
    means = lift.mean(axis=1)
    resultant = float(np.hypot(means[-1], drag[-1].mean()))
    return bool(abs(means[-1] - means[-2]) <= tolerance * resultant)
