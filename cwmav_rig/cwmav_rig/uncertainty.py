# SPDX-License-Identifier: Apache-2.0
"""Standard deviation of a correlated record with an interval, and the distribution that describes it.

Successive cycles are not independent. With v_k the mean square deviation from the overall mean within cycle k, the
variance of the estimate s^2 = mean(v) is the long-run variance of v over m cycles. It is taken from an autoregressive
model of v (order by AIC). The interval is that of a chi-square variable with the degrees of freedom
``nu = 2 s^4 / var(s^2)`` (Satterthwaite); nothing is assumed about the distribution of the record itself.
The mean is estimated from the same record, which lowers s^2 by the variance of that mean: this is added back
(Zhang, Metrologia 43 (2006) S276).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.linalg import solve_toeplitz

Array = NDArray[np.float64]

COVERAGE = 0.95
LARGEST_ORDER = 12
LEAST = 8  # cycles below which no interval is given


@dataclass(frozen=True)
class Fit:
    """A distribution fitted to a record.

    Attributes
    ----------
    name
        ``normal``, ``arcsine-normal`` (a sinusoid in normal noise), ``logistic``, ``skew-normal`` or ``student-t``.
    parameters
        Of the distribution, SI.
    statistic, p_value
        Kolmogorov-Smirnov distance and its p-value at the effective number of samples.
    bic
        Bayesian information criterion relative to that of the normal distribution; negative is better.
    """

    name: str
    parameters: tuple[float, ...]
    statistic: float
    p_value: float
    bic: float


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
    return _spread(
        kept, kept - kept.mean() if len(kept) else kept, (kept - kept.mean()) ** 2 if len(kept) else kept
    )


def spread_of_samples(
    time: Array, values: Array, bounds: Array, good: NDArray[np.bool_] | None = None
) -> Spread:
    """Spread of samples (n,) at `time`, grouped by the cycles between `bounds` (m + 1,).

    The whole scatter counts, that within a cycle too; the grouping is for the correlation.
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
    deviation = kept - kept.mean()
    means = np.bincount(owner, deviation, m)[has] / counts[has]
    squares = np.bincount(owner, deviation**2, m)[has] / counts[has]
    return _spread(kept, means, squares)


def _spread(values: Array, means: Array, squares: Array) -> Spread:
    nan = float("nan")
    if len(values) < 2 or len(squares) < LEAST:
        mean = float(values.mean()) if len(values) else nan
        std = float(values.std(ddof=1)) if len(values) > 1 else nan
        return Spread(mean, std, nan, nan, nan, len(values), float(len(squares)), nan, ())
    mean = float(values.mean())
    mean_variance = long_run_variance(means) / len(means)
    variance = float(np.mean((values - mean) ** 2)) + mean_variance
    if variance <= 0.0:
        return Spread(mean, 0.0, 0.0, 0.0, 0.0, len(values), float(len(means)), nan, ())
    scatter = long_run_variance(squares - squares.mean()) / len(squares)
    dof = float(np.clip(2.0 * variance**2 / max(scatter, 1e-300), 2.0, 1e9))
    tail = 0.5 * (1.0 - COVERAGE)
    low, high = np.sqrt(variance * dof / stats.chi2.ppf([1.0 - tail, tail], dof))
    effective = float(min(variance / mean_variance, len(values))) if mean_variance > 0 else float(len(values))
    fits = fit_distributions(values, min(effective, dof + 1.0))
    return Spread(
        mean,
        float(np.sqrt(variance)),
        float(low),
        float(high),
        float(np.sqrt(mean_variance)),
        len(values),
        effective,
        dof,
        fits,
    )


def long_run_variance(values: Array) -> float:
    """Variance of a sum of (m,) successive values per value: spectral density at zero of an autoregressive model.

    Yule-Walker, order by the corrected Akaike criterion.
    """
    m = len(values)
    x = values - values.mean()
    highest = min(LARGEST_ORDER, max(1, m // 8))
    covariance = np.array([np.dot(x[: m - k], x[k:]) / m for k in range(highest + 1)])
    if covariance[0] <= 0.0:
        return 0.0
    best, result = np.inf, covariance[0]
    for order in range(highest + 1):
        weights = solve_toeplitz(covariance[:order], covariance[1 : order + 1]) if order else np.empty(0)
        noise = float(covariance[0] - weights @ covariance[1 : order + 1])
        if noise <= 0.0:
            break
        criterion = m * np.log(noise) + 2.0 * (order + 1) * m / max(m - order - 2, 1)
        if criterion < best:
            best = criterion
            # Both moments are biased low by the order and the mean that were fitted.
            result = noise / max(1.0 - float(weights.sum()), 0.02) ** 2 * m / max(m - order - 1, 1)
    return float(result)


def fit_distributions(values: Array, effective: float) -> tuple[Fit, ...]:
    """Fit distributions to a record and sort them, best first.

    Likelihoods and distances are those of `effective` independent samples, so that a long correlated record does
    not make trifles significant.
    """
    sample = values if len(values) <= 4000 else values[:: len(values) // 4000 + 1]
    centre, width = float(sample.mean()), float(sample.std())
    if width == 0.0:
        return ()
    z = (sample - centre) / width
    number = max(min(effective, float(len(values))), 4.0)
    fits = [_assess(name, z, centre, width, number) for name in ("normal", *_FITTERS)]
    normal = fits[0].bic
    relative = [Fit(f.name, f.parameters, f.statistic, f.p_value, f.bic - normal) for f in fits]
    return tuple(sorted(relative, key=lambda fit: fit.bic))


def _assess(name: str, z: Array, centre: float, width: float, number: float) -> Fit:
    distribution = stats.norm(0.0, 1.0) if name == "normal" else _FITTERS[name](z)
    parameters = (0.0, 1.0) if name == "normal" else tuple(float(p) for p in distribution.args)
    likelihood = float(np.mean(distribution.logpdf(z))) * number
    distance = float(stats.kstest(z, distribution.cdf).statistic)
    p_value = float(stats.kstwobign.sf(distance * (np.sqrt(number) + 0.12 + 0.11 / np.sqrt(number))))
    bic = len(parameters) * np.log(number) - 2.0 * likelihood
    *shape, location, scale = parameters
    return Fit(name, (*shape, centre + width * location, width * scale), distance, p_value, float(bic))


class _ArcsineNormal(stats.rv_continuous):
    """Sum of a sinusoid of amplitude ``ratio * sqrt(2)`` and normal noise of deviation ``sqrt(1 - ratio^2)``.

    Its standard deviation is one. The density is the mean of the normal density over the phase of the sinusoid.
    """

    _PHASE = (np.arange(64) + 0.5) / 64.0 * np.pi

    def _pdf(self, x: Array, ratio: Array) -> Array:
        centre, noise = self._parts(ratio)
        return np.asarray(stats.norm.pdf(np.asarray(x)[..., None], centre, noise).mean(axis=-1))

    def _cdf(self, x: Array, ratio: Array) -> Array:
        centre, noise = self._parts(ratio)
        return np.asarray(stats.norm.cdf(np.asarray(x)[..., None], centre, noise).mean(axis=-1))

    def _parts(self, ratio: Array) -> tuple[Array, Array]:
        share = np.asarray(ratio)[..., None]
        return share * np.sqrt(2.0) * np.cos(self._PHASE), np.sqrt(np.maximum(1.0 - share**2, 1e-6))

    def _argcheck(self, ratio: Array) -> Array:
        return np.asarray((np.asarray(ratio) >= 0.0) & (np.asarray(ratio) < 1.0))


arcsine_normal = _ArcsineNormal(name="arcsine_normal")


def _fit_arcsine_normal(z: Array) -> stats.rv_continuous:
    # The fourth cumulant of a sinusoid of variance r^2 is -1.5 r^4, that of the noise is zero.
    ratio = float(np.clip(max(-stats.kurtosis(z), 0.0) / 1.5, 1e-6, 0.98) ** 0.25)
    return arcsine_normal(ratio, 0.0, 1.0)


def _fit_student(z: Array) -> stats.rv_continuous:
    excess = float(stats.kurtosis(z))
    shape = float(np.clip(4.0 + 6.0 / excess if excess > 0.01 else 200.0, 4.2, 200.0))
    return stats.t(shape, 0.0, np.sqrt((shape - 2.0) / shape))


def _fit_skew(z: Array) -> stats.rv_continuous:
    skew = float(np.clip(stats.skew(z), -0.95, 0.95))
    power = abs(skew) ** (2.0 / 3.0)
    delta = np.sign(skew) * np.sqrt(np.pi / 2.0 * power / (power + ((4.0 - np.pi) / 2.0) ** (2.0 / 3.0)))
    scale = 1.0 / np.sqrt(1.0 - 2.0 * delta**2 / np.pi)
    shape = delta / np.sqrt(max(1.0 - delta**2, 1e-9))
    return stats.skewnorm(shape, -scale * delta * np.sqrt(2.0 / np.pi), scale)


def _fit_logistic(z: Array) -> stats.rv_continuous:
    return stats.logistic(0.0, np.sqrt(3.0) / np.pi)


_FITTERS = {
    "arcsine-normal": _fit_arcsine_normal,
    "logistic": _fit_logistic,
    "skew-normal": _fit_skew,
    "student-t": _fit_student,
}
