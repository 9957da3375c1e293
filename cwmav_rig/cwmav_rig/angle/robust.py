# SPDX-License-Identifier: Apache-2.0
"""Robust regression of points in a row, with a covariance that knows of outliers and correlated neighbours.

M-estimate with Tukey's biweight by iteratively reweighted least squares; covariance by the sandwich
``A^-1 B A^-1`` (Huber, Robust Statistics, 1981, section 7.6). ``B`` holds the correlation of neighbouring
points: that which follows from the pixels they share, or that seen in the residuals, with Bartlett weights
(Newey and West, Econometrica 55, 1987), whichever gives the larger variance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Slots = NDArray[np.int64]

TUNING = 4.685  # 95 % efficiency at Gaussian errors
_MEDIAN_TO_SIGMA = 1.4826
_SMALLEST_SCALE = 1e-9
_SCALE_UPDATES = 5


@dataclass(frozen=True)
class Fit:
    """Estimate of a linear model.

    Attributes
    ----------
    coefficients
        (p,).
    covariance
        (p, p).
    weights
        (n,) between 0 (outlier) and 1.
    scale
        Robust standard deviation of the residuals.
    correlation
        Factor by which correlation between neighbours enlarged the last coefficient's variance.
    """

    coefficients: Array
    covariance: Array
    weights: Array
    scale: float
    correlation: float


def fit_linear(
    design: Array,
    values: Array,
    slots: Slots,
    start: Array,
    *,
    neighbours: Array | None = None,
    ring: int | None = None,
) -> Fit:
    """Fit ``values ~ design @ coefficients``.

    Parameters
    ----------
    design
        (n, p), rows divided by the expected standard deviation of their point when these differ.
    values
        (n,), divided likewise.
    slots
        (n,) place of each point in its row of equidistant places, increasing; tells who is whose neighbour.
    start
        (p,) first guess, already robust.
    neighbours
        (m,) known correlation of the errors of points 1 to m places apart; none when not given.
    ring
        Number of places when the row is a ring, the last place a neighbour of the first.
    """
    coefficients, scale = estimate(design, values, start)
    scaled = (values - design @ coefficients) / scale
    known = np.empty(0) if neighbours is None else neighbours
    covariance, correlation = _covariance(design, scaled, scale, Row(slots, known, ring))
    return Fit(coefficients, covariance, _weights(scaled), scale, correlation)


def estimate(design: Array, values: Array, start: Array) -> tuple[Array, float]:
    """Give only coefficients (p,) and scale of :func:`fit_linear`."""
    coefficients, scale = _reweighted(np.ascontiguousarray(design), np.ascontiguousarray(values), start)
    return coefficients, float(scale)


@dataclass(frozen=True)
class Line:
    """A straight line through points with its uncertainty.

    Attributes
    ----------
    centre
        (2,) point on the line about which offset and angle are estimated.
    angle
        Direction [rad], between -pi/2 and pi/2, counted from x towards y.
    angle_std, offset_std
        Standard errors [rad, px].
    weights
        (n,) of the points.
    scale
        Standard deviation of points of median precision about the line [px].
    correlation
        See :class:`Fit`.
    """

    centre: Array
    angle: float
    angle_std: float
    offset_std: float
    weights: Array
    scale: float
    correlation: float

    @property
    def direction(self) -> Array:
        """Unit vector, (2,)."""
        return _direction(self.angle)


def fit_line(points: Array, slots: Slots, std: Array, neighbours: Array | None = None) -> Line:
    """Robust total least squares: the line that makes the *orthogonal* distances small.

    In coordinates along and across the present line, the distances are regressed on the position and the line
    is turned by the slope found, until the slope is zero. There the conditions of orthogonal regression hold.

    Parameters
    ----------
    points
        (n, 2), n >= 3, in order along the line.
    std
        (n,) expected standard deviations of the points; only their ratios matter for line and standard error.
    slots, neighbours
        See :func:`fit_linear`.
    """
    angle, centre = _least_median_line(points)
    relative = std / np.median(std)
    for _ in range(20):
        along, across = _frame(points, centre, angle)
        design = np.column_stack([np.ones(len(points)), along]) / relative[:, None]
        coefficients, scale = estimate(design, across / relative, np.zeros(2))
        weights = _weights((across / relative - design @ coefficients) / scale) / relative**2
        foot = float((weights * along).sum() / weights.sum())
        height = coefficients[0] + coefficients[1] * foot
        centre = centre + foot * _direction(angle) + height * _direction(angle + np.pi / 2)
        turn = float(np.arctan(coefficients[1]))
        angle += turn
        if abs(turn) < 1e-10 and abs(foot) < 1e-6:
            break
    along, across = _frame(points, centre, angle)
    design = np.column_stack([np.ones(len(points)), along]) / relative[:, None]
    fit = fit_linear(design, across / relative, slots, np.zeros(2), neighbours=neighbours)
    wrapped = (angle + np.pi / 2) % np.pi - np.pi / 2
    return Line(
        centre=centre,
        angle=float(wrapped),
        angle_std=float(np.sqrt(fit.covariance[1, 1])),
        offset_std=float(np.sqrt(fit.covariance[0, 0])),
        weights=fit.weights,
        scale=fit.scale,
        correlation=fit.correlation,
    )


def _frame(points: Array, centre: Array, angle: float) -> tuple[Array, Array]:
    shifted = points - centre
    return shifted @ _direction(angle), shifted @ _direction(angle + np.pi / 2)


def _direction(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])


def _least_median_line(points: Array) -> tuple[float, Array]:
    """Line through two of the points with the least median distance of all; nothing random in the choice."""
    judges = points[:: max(1, len(points) // 64)]
    chosen = points[np.unique(np.linspace(0, len(points) - 1, 20).astype(int))]
    first, second = np.triu_indices(len(chosen), k=max(1, len(chosen) // 4))
    step = chosen[second] - chosen[first]
    length = np.hypot(step[:, 0], step[:, 1])
    good = length > 0
    first, step, length = first[good], step[good], length[good]
    normal = np.column_stack([-step[:, 1], step[:, 0]]) / length[:, None]
    distance = np.abs(normal @ judges.T - (normal * chosen[first]).sum(axis=1)[:, None])
    best = int(np.argmin(np.median(distance, axis=1)))
    return float(np.arctan2(step[best, 1], step[best, 0])), chosen[first[best]]


@njit(cache=True)
def _reweighted(design: Array, values: Array, start: Array) -> tuple[Array, float]:
    """Iterate weighted least squares from `start`; compiled, because a frame needs many small fits."""
    count, parameters = design.shape
    coefficients = start.copy()
    # Rousseeuw and Leroy 1987: the median of few residuals is too small.
    to_sigma = _MEDIAN_TO_SIGMA * (1.0 + 5.0 / max(count - parameters, 1))
    scale = 0.0
    for iteration in range(60):
        residuals = values - design @ coefficients
        if iteration < _SCALE_UPDATES:  # later the scale stays, so that the iteration converges
            scale = max(to_sigma * np.median(np.abs(residuals)), _SMALLEST_SCALE)
        normal = np.zeros((parameters, parameters))
        right = np.zeros(parameters)
        for i in range(count):
            ratio = residuals[i] / (scale * TUNING)
            if abs(ratio) >= 1.0:
                continue
            weight = (1.0 - ratio * ratio) ** 2
            for j in range(parameters):
                right[j] += weight * design[i, j] * residuals[i]
                for k in range(parameters):
                    normal[j, k] += weight * design[i, j] * design[i, k]
        change = np.linalg.lstsq(normal, right)[0]
        coefficients += change
        if iteration >= _SCALE_UPDATES and np.abs(design @ change).max() < 1e-8 * scale:
            break
    return coefficients, scale


def _weights(scaled: Array) -> Array:
    return np.where(np.abs(scaled) < TUNING, (1.0 - (scaled / TUNING) ** 2) ** 2, 0.0)


def _slope_of_psi(scaled: Array) -> Array:
    ratio = (scaled / TUNING) ** 2
    return np.where(ratio < 1.0, (1.0 - ratio) * (1.0 - 5.0 * ratio), 0.0)


@dataclass(frozen=True)
class Row:
    """Who is whose neighbour: see :func:`fit_linear`."""

    slots: Slots
    neighbours: Array
    ring: int | None

    def correlation(self, used: NDArray[np.bool_]) -> Array:
        """Correlation matrix of the used points by their distance in the row, (m, m)."""
        places = self.slots[used]
        apart = np.abs(places[:, None] - places[None, :])
        if self.ring:
            apart = np.minimum(apart, self.ring - apart)
        table = np.concatenate([[1.0], self.neighbours, [0.0]])
        return np.asarray(table[np.minimum(apart, len(table) - 1)])

    def scores(self, values: Array) -> Array:
        """Put the rows of `values` at their places, zeros where there is no point."""
        first = 0 if self.ring else int(self.slots[0])
        placed = np.zeros((self.ring or int(self.slots[-1]) - first + 1, values.shape[1]))
        placed[self.slots - first] = values
        return placed


def _covariance(design: Array, scaled: Array, scale: float, row: Row) -> tuple[Array, float]:
    """Covariance of the coefficients, and by how much correlation enlarged the variance of the last one."""
    used = np.abs(scaled) < TUNING
    slope = _slope_of_psi(scaled)
    bread = np.linalg.pinv((design * slope[:, None]).T @ design)
    psi = _weights(scaled) * scaled * scale
    inner = design[used]
    count, parameters = max(int(used.sum()), design.shape[1] + 1), design.shape[1]
    # Huber 1981, section 7.6: few points and a curved psi make the plain formula too small.
    finite = (1.0 + parameters / count * float(np.var(slope[used])) / float(np.mean(slope[used])) ** 2) ** 2
    omega = row.correlation(used)
    variance = float(np.sum(psi**2)) / _freedom(inner, omega, parameters)
    white = finite * variance * bread @ inner.T @ inner @ bread
    known = finite * variance * bread @ inner.T @ omega @ inner @ bread
    placed = row.scores(design * psi[:, None])
    meat = _with_neighbours(placed, _lags(count), closed=row.ring is not None)
    seen = finite * count / (count - parameters) * bread @ meat @ bread
    # What is seen in few residuals is itself uncertain; a standard error is never made smaller by it.
    enlarge = np.sqrt(np.maximum(1.0, np.diag(seen) / np.diag(known)))
    covariance = known * enlarge[:, None] * enlarge[None, :]
    return covariance, float(covariance[-1, -1] / white[-1, -1])


def _freedom(design: Array, omega: Array, parameters: int) -> float:
    """Give the expected sum of squared residuals over the variance, ``tr((I - H) Omega)``: n - p if white."""
    count = len(design)
    if count <= parameters:
        return 1.0
    hat = design @ np.linalg.pinv(design)
    return max(float(count - np.sum(hat * omega)), 1.0)


def _lags(count: int) -> int:
    return int(4.0 * (count / 100.0) ** (2.0 / 9.0))


def _with_neighbours(placed: Array, lags: int, *, closed: bool) -> Array:
    total = placed.T @ placed
    for lag in range(1, min(lags, len(placed) - 1) + 1):
        gamma = placed.T @ np.roll(placed, lag, axis=0) if closed else placed[lag:].T @ placed[:-lag]
        total = total + (1.0 - lag / (lags + 1.0)) * (gamma + gamma.T)
    return np.asarray(total)
