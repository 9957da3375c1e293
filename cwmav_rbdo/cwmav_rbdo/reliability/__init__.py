# SPDX-License-Identifier: Apache-2.0
"""Probability of failure of a design whose variables scatter: one method a file, one kind of result."""

from cwmav_rbdo.reliability.active_learning import LearningSettings, UnsureError, active_learning
from cwmav_rbdo.reliability.certified import certified, certified_estimate
from cwmav_rbdo.reliability.convolved_field import ConvolvedField, GridLimitState
from cwmav_rbdo.reliability.directional import directional, directional_estimate
from cwmav_rbdo.reliability.estimate import Band, Estimate
from cwmav_rbdo.reliability.form import form
from cwmav_rbdo.reliability.importance_sampling import importance_sampling
from cwmav_rbdo.reliability.inputs import Copula, GaussianNoise, Inputs, LimitState
from cwmav_rbdo.reliability.line_root import line_root, line_root_estimate
from cwmav_rbdo.reliability.line_sampling import line_sampling
from cwmav_rbdo.reliability.monte_carlo import monte_carlo, monte_carlo_band, monte_carlo_designs
from cwmav_rbdo.reliability.subset_simulation import subset_simulation

__all__ = [
    "Band",
    "ConvolvedField",
    "Copula",
    "Estimate",
    "GaussianNoise",
    "GridLimitState",
    "Inputs",
    "LearningSettings",
    "LimitState",
    "UnsureError",
    "active_learning",
    "certified",
    "certified_estimate",
    "directional",
    "directional_estimate",
    "form",
    "importance_sampling",
    "line_root",
    "line_root_estimate",
    "line_sampling",
    "monte_carlo",
    "monte_carlo_band",
    "monte_carlo_designs",
    "subset_simulation",
]
