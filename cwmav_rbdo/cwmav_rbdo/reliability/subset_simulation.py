# SPDX-License-Identifier: Apache-2.0
"""Subset simulation: a rare event as a chain of frequent ones (Au and Beck 2001, Prob. Eng. Mech. 16:263)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError, WorkError
from cwmav_rbdo.reliability.estimate import Estimate
from cwmav_rbdo.reliability.inputs import Inputs, LimitState, standard_limit_state

Array = NDArray[np.float64]

LEVELS = 40
TARGET_ACCEPTANCE = 0.44


def subset_simulation(
    g: LimitState,
    inputs: Inputs,
    rng: np.random.Generator,
    samples: int = 10_000,
    conditional: float = 0.1,
) -> Estimate:
    """Estimate a small probability level by level.

    The chains are moved by conditional sampling with adapted correlation (Papaioannou, Betz, Zwirglmaier
    and Straub 2015, Prob. Eng. Mech. 41:89), which does not degrade with the number of variables.

    Parameters
    ----------
    g : callable
    inputs : Inputs
    rng : numpy.random.Generator
    samples : int
        Points per level.
    conditional : float
        Conditional probability of each level but the last, 0 < conditional <= 0.5.

    Returns
    -------
    Estimate
        Its standard error counts the correlation along the chains (Au and Beck 2001, Eq. 29), not that
        between levels.

    Raises
    ------
    WorkError
        If failure is not reached in 40 levels.
    """
    if not 0.0 < conditional <= 0.5 or samples * conditional < 2:
        raise InputError(
            f"conditional = {conditional}, samples = {samples}: allowed are 0 < conditional <= 0.5 and "
            "at least 2 points beyond each level"
        )
    evaluate = standard_limit_state(g, inputs)
    seeds = int(samples * conditional)
    length = math.ceil(samples / seeds)
    U = rng.standard_normal((seeds, length, inputs.dimension))
    values = evaluate(U.reshape(seeds * length, -1)).reshape(seeds, length)
    count = seeds * length
    probability, relative_variance, evaluations, spread = 1.0, 0.0, count, 0.8
    for level in range(LEVELS):
        order = np.argsort(values, axis=None, kind="stable")
        threshold = float(values.flat[order[seeds - 1]])
        last = threshold <= 0.0
        below = values <= (0.0 if last else threshold)
        share = float(below.mean())
        probability *= share
        relative_variance += _relative_variance(below, share, independent=level == 0)
        if last:
            std = probability * math.sqrt(relative_variance)
            return Estimate(probability, std, evaluations, "subset_simulation")
        start, start_values = U.reshape(count, -1)[order[:seeds]], values.reshape(count)[order[:seeds]]
        # A random order keeps neighbouring chains from being adapted on like seeds.
        mixed = rng.permutation(seeds)
        U, values, spread = _chains(
            evaluate, start[mixed], start_values[mixed], threshold, length, spread, rng
        )
        evaluations += seeds * (length - 1)
    raise WorkError(
        f"subset simulation: no failure within {LEVELS} levels, probability below {probability:.1g}"
    )


def _chains(
    g: LimitState,
    start: Array,
    start_values: Array,
    threshold: float,
    length: int,
    spread: float,
    rng: np.random.Generator,
) -> tuple[Array, Array, float]:
    """Move all seeds in parallel, staying below the threshold; returns states, values, adapted spread."""
    seeds, d = start.shape
    U, values = np.empty((seeds, length, d)), np.empty((seeds, length))
    U[:, 0], values[:, 0] = start, start_values
    for step in range(1, length):
        keep = math.sqrt(1.0 - spread**2)
        proposed = keep * U[:, step - 1] + spread * rng.standard_normal((seeds, d))
        proposed_values = g(proposed)
        accepted = proposed_values <= threshold
        U[:, step] = np.where(accepted[:, None], proposed, U[:, step - 1])
        values[:, step] = np.where(accepted, proposed_values, values[:, step - 1])
        change = (float(accepted.mean()) - TARGET_ACCEPTANCE) / math.sqrt(step)
        spread = min(max(spread * math.exp(change), 0.01), 1.0)
    return U, values, spread


def _relative_variance(below: NDArray[np.bool_], share: float, independent: bool) -> float:
    """Squared coefficient of variation of one level, chains (rows) being correlated along their length."""
    if share in (0.0, 1.0):
        return 0.0
    seeds, length = below.shape
    centred = below - share
    variance = share * (1.0 - share)
    factor = 1.0
    if not independent:
        for lag in range(1, length):
            correlation = float(np.mean(centred[:, :-lag] * centred[:, lag:])) / variance
            factor += 2.0 * (1.0 - lag / length) * correlation
    return float(max(factor, 1.0) * variance / (share**2 * seeds * length))
