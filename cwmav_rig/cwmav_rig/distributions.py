# SPDX-License-Identifier: Apache-2.0
"""Distributions that a record may follow, fitted by moments, compared by information, tested by distance.

Every candidate has the mean and the standard deviation of the record; its shape follows from skewness or
kurtosis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.special import expit, gammaln, log_ndtr, ndtr, owens_t, stdtr

Array = NDArray[np.float64]
Function = Callable[[Array], Array]

LARGEST_SAMPLE = 2000  # values that enter a fit; longer records are thinned evenly
_DEGREES = (3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 20.0, 40.0)  # of Student's t; more is normal
_PHASES = (np.arange(32) + 0.5) / 32.0 * np.pi


@dataclass(frozen=True)
class Fit:
    """A distribution fitted to a record.

    Attributes
    ----------
    name
        ``normal``, ``arcsine-normal`` (a sinusoid in normal noise), ``logistic``, ``skew-normal`` or
        ``student-t``.
    shape
        Its shape parameter: share of the sinusoid in the deviation, slant, degrees of freedom; none for the
        others.
    statistic, p_value
        Kolmogorov-Smirnov distance and its p-value at the effective number of samples. The parameters come
        from the same record, so the p-value is on the high side: a low one speaks against the distribution,
        a high one does not prove it.
    bic
        Bayesian information criterion less that of the normal distribution; negative is better.
    """

    name: str
    shape: float | None
    statistic: float
    p_value: float
    bic: float


@dataclass(frozen=True)
class Candidate:
    """A distribution of mean zero and standard deviation one."""

    name: str
    shape: float | None
    logpdf: Function
    cdf: Function


def fit_distributions(values: Array, effective: float) -> tuple[Fit, ...]:
    """Fit all candidates to a record (n,) and sort them, best first.

    Likelihoods and distances are those of `effective` independent samples, so that a long correlated record
    does not make trifles significant.
    """
    sample = values[:: len(values) // LARGEST_SAMPLE + 1]
    width = float(sample.std())
    if width <= 1e-12 * float(np.abs(sample).max()):
        return ()  # one value, but for rounding
    z = np.sort((sample - sample.mean()) / width)
    number = max(min(effective, float(len(sample))), 4.0)
    fits = [_assess(candidate, z, number) for candidate in candidates(z)]
    normal = fits[0].bic
    relative = [Fit(f.name, f.shape, f.statistic, f.p_value, f.bic - normal) for f in fits]
    return tuple(sorted(relative, key=lambda fit: fit.bic))


def candidates(z: Array) -> tuple[Candidate, ...]:
    """Give the candidates for a standardised record; the normal distribution is the first."""
    return (_normal(), _logistic(), _arcsine_normal(z), _skew_normal(z), _student(z))


def _assess(candidate: Candidate, z: Array, number: float) -> Fit:
    likelihood = float(np.mean(candidate.logpdf(z))) * number
    below = candidate.cdf(z)
    steps = np.arange(len(z) + 1) / len(z)
    distance = float(max(np.max(steps[1:] - below), np.max(below - steps[:-1])))
    # Kolmogorov's limit with the small-sample factor of Stephens (1970).
    p_value = float(stats.kstwobign.sf(distance * (np.sqrt(number) + 0.12 + 0.11 / np.sqrt(number))))
    parameters = 2 if candidate.shape is None else 3
    bic = parameters * np.log(number) - 2.0 * likelihood
    return Fit(candidate.name, candidate.shape, distance, p_value, float(bic))


def _normal() -> Candidate:
    return Candidate("normal", None, _normal_logpdf, ndtr)


def _logistic() -> Candidate:
    scale = np.sqrt(3.0) / np.pi
    return Candidate(
        "logistic",
        None,
        lambda z: -z / scale - np.log(scale) - 2.0 * np.log1p(np.exp(-z / scale)),
        lambda z: expit(z / scale),
    )


def _arcsine_normal(z: Array) -> Candidate:
    """Sinusoid plus normal noise: the mean of normal densities over the phase of the sinusoid."""
    # The fourth cumulant of a sinusoid of variance r^2 is -1.5 r^4, that of the noise is zero.
    share = float(np.clip(max(-float(stats.kurtosis(z)), 0.0) / 1.5, 1e-8, 0.92) ** 0.25)
    centres = share * np.sqrt(2.0) * np.cos(_PHASES)
    noise = np.sqrt(1.0 - share**2)

    def logpdf(x: Array) -> Array:
        return np.asarray(
            np.log(
                np.maximum(
                    np.exp(_normal_logpdf((x[:, None] - centres) / noise)).mean(axis=1) / noise, 1e-300
                )
            )
        )

    def cdf(x: Array) -> Array:
        return np.asarray(ndtr((x[:, None] - centres) / noise).mean(axis=1))

    return Candidate("arcsine-normal", share, logpdf, cdf)


def _skew_normal(z: Array) -> Candidate:
    skew = float(np.clip(stats.skew(z), -0.95, 0.95))
    power = abs(skew) ** (2.0 / 3.0)
    delta = float(
        np.sign(skew) * np.sqrt(np.pi / 2.0 * power / (power + ((4.0 - np.pi) / 2.0) ** (2.0 / 3.0)))
    )
    scale = 1.0 / np.sqrt(1.0 - 2.0 * delta**2 / np.pi)
    slant = delta / np.sqrt(max(1.0 - delta**2, 1e-9))
    location = -scale * delta * np.sqrt(2.0 / np.pi)
    return Candidate(
        "skew-normal",
        float(slant),
        lambda x: _skew_logpdf((x - location) / scale, slant) - np.log(scale),
        lambda x: ndtr((x - location) / scale) - 2.0 * owens_t((x - location) / scale, slant),
    )


def _skew_logpdf(u: Array, slant: float) -> Array:
    return np.asarray(np.log(2.0) + _normal_logpdf(u) + log_ndtr(slant * u))


def _normal_logpdf(u: Array) -> Array:
    return np.asarray(-0.5 * u**2 - 0.5 * np.log(2.0 * np.pi))


def _student(z: Array) -> Candidate:
    tried = [_student_of(dof) for dof in _DEGREES]
    return max(tried, key=lambda candidate: float(candidate.logpdf(z).sum()))


def _student_of(dof: float) -> Candidate:
    scale = float(np.sqrt((dof - 2.0) / dof))
    constant = gammaln(0.5 * (dof + 1.0)) - gammaln(0.5 * dof) - 0.5 * np.log(np.pi * dof) - np.log(scale)

    def logpdf(x: Array) -> Array:
        return np.asarray(constant - 0.5 * (dof + 1.0) * np.log1p((x / scale) ** 2 / dof))

    return Candidate("student-t", dof, logpdf, lambda x: np.asarray(stdtr(dof, x / scale)))
