# SPDX-License-Identifier: Apache-2.0
"""Probability of failure of a design whose variables scatter: one method a file, one kind of result."""

from cwmav_rbdo.reliability.estimate import Band, Estimate
from cwmav_rbdo.reliability.inputs import Copula, GaussianNoise, Inputs, LimitState
from cwmav_rbdo.reliability.monte_carlo import monte_carlo, monte_carlo_band, monte_carlo_designs

__all__ = [
    "Band",
    "Copula",
    "Estimate",
    "GaussianNoise",
    "Inputs",
    "LimitState",
    "monte_carlo",
    "monte_carlo_band",
    "monte_carlo_designs",
]
