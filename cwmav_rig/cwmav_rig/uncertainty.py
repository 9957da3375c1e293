# SPDX-License-Identifier: Apache-2.0
"""Standard deviation of a correlated record with an interval, and the distribution that describes it.

Successive cycles are not independent. A record of values x with variance s^2 and autocorrelation rho has

    var(mean) = s^2 (1 + 2 sum rho_k) / n
    var(s^2)  = s^4 (2 (1 + 2 sum rho_k^2) + kappa) / n

with the excess kurtosis kappa of the innovations (Bartlett's formula; Brockwell & Davis, Time Series, 7.3).
The correlation is that of an autoregressive model of the cycle means. Scatter within the cycles (a body
that rocks with the wings, reading noise) adds its own variance. The interval is that of a chi-square
variable with the degrees of freedom ``nu = 2 s^4 / var(s^2)`` (Satterthwaite). The mean is estimated from
the same record, which lowers s^2 by var(mean); this is added back (Zhang, Metrologia 43 (2006) S276).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from cwmav_rig.autoregression import memory_of
from cwmav_rig.distributions import Fit, fit_distributions

Array = NDArray[np.float64]

COVERAGE = 0.95
_ROUNDS = 40  # of the search for a bound; its step halves the distance
LEAST = 8  # cycles below which no interval is given


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation of one quantity with the 95 % interval of the latter.

    Attributes
    ----------
    mean_std
        Standard uncertainty of the mean.
    effective
        Number of independent cycles that would tell as much about the mean.
    degrees_of_freedom
        Of the standard deviation.
    fits
        Distributions tried, best first.
    """

    mean: float
    std: float
    std_low: float
    std_high: float
    mean_std: float
    samples: int
    effective: float
    degrees_of_freedom: float
    fits: tuple[Fit, ...]

    @property
    def distribution(self) -> str:
        """Name of the best fitting distribution; empty without data."""
        return self.fits[0].name if self.fits else ""


def spread_of_cycles(values: Array) -> Spread:
    """Spread of one value per cycle, (m,), in the order of the cycles; NaN are left out."""
    kept = np.asarray(values, float)
    kept = kept[np.isfinite(kept)]
    return _spread(kept, kept, np.zeros(len(kept)))


def spread_of_samples(
    time: Array, values: Array, bounds: Array, good: NDArray[np.bool_] | None = None
) -> Spread:
    """Spread of samples (n,) at `time`, grouped by the cycles between `bounds` (m + 1,).

    The whole scatter counts, that within a cycle too; the grouping is for the correlation.

    Parameters
    ----------
    good
        (m,) cycles that may be used; all when not given.
    """
    owner = np.searchsorted(bounds, time, side="right") - 1
    m = len(bounds) - 1
    usable = (owner >= 0) & (owner < m) & np.isfinite(values)
    if good is not None:
        usable &= good[np.clip(owner, 0, m - 1)]
    owner, kept = owner[usable], np.asarray(values, float)[usable]
    if not len(kept):
        return _spread(kept, kept, kept)
    counts = np.bincount(owner, minlength=m)
    has = counts > 0
    means = np.bincount(owner, kept, m)[has] / counts[has]
    all_means = np.zeros(m)
    all_means[has] = means
    within = np.bincount(owner, (kept - all_means[owner]) ** 2, m)[has] / counts[has]
    return _spread(kept, means, within)


def _spread(values: Array, means: Array, within: Array) -> Spread:
    """Spread of `values` from the means of the cycles and the variances within them."""
    nan = float("nan")
    m = len(means)
    mean = float(values.mean()) if len(values) else nan
    if len(values) < 2 or m < LEAST:
        std = float(values.std(ddof=1)) if len(values) > 1 else nan
        return Spread(mean, std, nan, nan, nan, len(values), float(m), nan, ())
    between, inside = memory_of(means), memory_of(within)
    variance = between.variance + float(within.mean())
    if variance <= 0.0:
        return Spread(mean, 0.0, 0.0, 0.0, 0.0, len(values), float(m), nan, ())
    of_mean = between.variance * between.sum_correlations / m
    effective = float(np.clip(variance / of_mean, 1.0, len(values))) if of_mean > 0.0 else float(len(values))
    kurtosis = max(between.kurtosis, -1.0)
    # What was added for the removed mean is as uncertain as the memory and goes with the variance.
    added = (1.0 + 2.0 / effective) ** 2
    scatter = _Scatter(
        between.variance,
        between.variance**2 * (2.0 * between.sum_squares + kurtosis) / m * added,
        float(within.mean()),
        inside.variance * inside.sum_correlations / m,
        m,
    )
    dof = scatter.dof(1.0)
    low, high = (float(np.sqrt(variance)) * bound for bound in _bounds(scatter))
    return Spread(
        mean=mean,
        std=float(np.sqrt(variance)),
        std_low=float(low),
        std_high=float(high),
        mean_std=float(np.sqrt(of_mean)),
        samples=len(values),
        effective=effective,
        degrees_of_freedom=dof,
        fits=fit_distributions(values, min(effective, dof + 1.0)),
    )


@dataclass(frozen=True)
class _Scatter:
    """Variance between the means of m cycles and within them, each with the variance of its estimate."""

    between: float
    of_between: float
    within: float
    of_within: float
    cycles: int

    def dof(self, ratio: float) -> float:
        """Degrees of freedom of the variance found, if the true one is `ratio` times as large.

        The innovations of a record are known far better than its memory. So a larger true variance means a
        larger one between the cycles and a longer memory there, which leaves fewer degrees of freedom:
        ``of_between`` grows with the power 2 + p of the variance between, p from 0 (independent means) to 1.
        """
        total = self.between + self.within
        freedom = 2.0 * self.between**2 / max(self.of_between, 1e-300)
        power = 2.0 + max(0.0, 1.0 - freedom / self.cycles)
        changed = max(self.between + (ratio - 1.0) * total, 0.05 * self.between)
        grown = (changed / self.between) ** power if self.between > 0.0 else 1.0
        of_variance = max(self.of_between * grown + self.of_within, 1e-300)
        return float(np.clip(2.0 * (ratio * total) ** 2 / of_variance, 1.0, 1e9))


def _bounds(scatter: _Scatter) -> tuple[float, float]:
    """Bounds of the true over the found standard deviation: beyond, the one found would be too unlikely."""
    tail = 0.5 * (1.0 - COVERAGE)
    usual = scatter.dof(1.0)
    found = []
    for probability in (1.0 - tail, tail):
        ratio = 1.0
        for _ in range(_ROUNDS):
            freedom = float(np.clip(scatter.dof(ratio), 0.5 * usual, 2.0 * usual))
            ratio = 0.5 * (ratio + freedom / (2.0 * float(gammaincinv(0.5 * freedom, probability))))
        found.append(float(np.sqrt(ratio)))
    return found[0], found[1]
