# SPDX-License-Identifier: Apache-2.0
"""What every reliability method returns."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.special import ndtri


@dataclass(frozen=True)
class Estimate:
    """Estimate of a probability of failure.

    Attributes
    ----------
    value : float
        Probability of failure Pr(g <= 0).
    std : float
        Standard error of `value`, and so of the reliability: sampling error of a sampling method, estimate
        of the discretisation error of a deterministic one, nan where a method (FORM) knows no error.
    evaluations : int
        Points at which the limit state was evaluated.
    method : str
        Name of the method.
    """

    value: float
    std: float
    evaluations: int
    method: str

    @property
    def reliability(self) -> float:
        """``1 - value``."""
        return 1.0 - self.value

    @property
    def beta(self) -> float:
        """Generalised reliability index, ``-Phi^-1(value)``; infinite for a probability of 0 or 1."""
        return float(-ndtri(self.value))


@dataclass(frozen=True)
class Band:
    """Reliability with the uncertainty of the surrogate.

    Attributes
    ----------
    mean_surface : Estimate
        Of the surrogate's mean alone, as in the paper.
    expected : Estimate
        Averaged over the surrogate's own normal uncertainty at each point, E[Phi(-mean/std)].
    low, high : Estimate
        Probability of failure of the surfaces mean + k std (low) and mean - k std (high).
    """

    mean_surface: Estimate
    expected: Estimate
    low: Estimate
    high: Estimate

    @property
    def reliability(self) -> tuple[float, float]:
        """Lower and upper end of the band on the reliability."""
        return 1.0 - self.high.value, 1.0 - self.low.value
