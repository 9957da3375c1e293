# SPDX-License-Identifier: Apache-2.0
"""``paper_surface``: a lift and power surface with both printed optima, made for the study's tables alone.

The paper gives no power data and no lift at the points of its study, so its surface cannot be rebuilt. What
is printed allows this construction. The ratio is a Gaussian ridge whose maximum over F, AoA, U is the printed
three-variable optimum and whose maximum at U = 3 m/s is the printed two-variable one, both with the printed
values; the two curvatures that this leaves free are fitted to the lifts of Table 3. Power is the law

    P = 0.35 + 0.202 |L| F + 0.0435 U^2 sin(AoA)^2 F      [W; N, Hz, m/s]

and lift is what makes the ratio. The law has no term in F^3, which a flapping drive has: this is no model of
a vehicle, and is used for nothing but the comparison with Tables 5 to 7.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Future
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cwmav_rbdo.evaluation import Evaluation
from cwmav_rbdo.reproduction.tables import paper_table

Array = NDArray[np.float64]

OPTIMUM_3 = np.array([10.4810, 18.2278, 4.1772])  # Hz, deg, m/s: Table 6
OPTIMUM_2 = np.array([10.3579, 21.4935, 3.0])  # Table 5
RATIO_3, RATIO_2 = 0.1414, 0.1301  # N/W
SOURCE = "paper_surface: constructed from the printed optima and Table 3"


def law_power(lift: Array, point: Array) -> Array:
    """Power of the empirical law at points (n, 3) in Hz, deg, m/s [W]."""
    f, a, u = point.T
    return np.asarray(0.35 + 0.202 * np.abs(lift) * f + 0.0435 * u**2 * np.sin(np.radians(a)) ** 2 * f)


def ratio(point: Array, curvature: Array | None = None) -> Array:
    """Lift-to-power ratio at points (n, 3) in Hz, deg, m/s [N/W]."""
    H = _hessian(_curvatures() if curvature is None else curvature)
    away = point - OPTIMUM_3
    return np.asarray(RATIO_3 * np.exp(-0.5 * np.einsum("ni,ij,nj->n", away, H, away)))


def lift(point: Array, curvature: Array | None = None) -> Array:
    """Lift that, with the power law, makes the ratio; (n,) [N]."""
    r = ratio(point, curvature)
    fixed = law_power(np.zeros(len(point)), point)
    return np.asarray(r * fixed / (1.0 - 0.202 * r * point[:, 0]))


def reach(loss: float, variables: Sequence[int]) -> Array:
    """Farthest way from the maximum, in each of these variables, that costs a share `loss` of the ratio.

    Parameters
    ----------
    loss : between 0 and 1
    variables : of F, AoA, U by number; the others are held at the maximum

    Returns
    -------
    (k,) array in Hz, deg, m/s
    """
    H = _hessian(_curvatures())[np.ix_(variables, variables)]
    return np.asarray(np.sqrt(-2.0 * np.log1p(-loss) * np.diag(np.linalg.inv(H))))


class PaperSurface:
    """Evaluator of the surface; its uncertainties are those of a round-off, since it is a formula."""

    workers = 1

    def submit(self, point: Array) -> Future[Evaluation]:
        """Evaluate at F [Hz], AoA [rad], U [m/s]."""
        at = np.array([[point[0], math.degrees(point[1]), point[2]]])
        force = lift(at)
        future: Future[Evaluation] = Future()
        future.set_result(
            Evaluation(float(force[0]), 0.0, float(law_power(force, at)[0]), 0.0, SOURCE, SOURCE)
        )
        return future

    def close(self) -> None:
        """Nothing to give back."""


def table3_deviation() -> float:
    """Root mean square relative deviation of the surface's lift from the rows of Table 3 it is fitted to."""
    points, lifts = _anchors()
    return float(np.sqrt(np.mean((lift(points) / lifts - 1.0) ** 2)))


def _hessian(curvature: Array) -> Array:
    """Curvature matrix that puts the maximum at U = 3 m/s where Table 5 has it, with its value."""
    H = np.zeros((3, 3))
    H[0, 0], H[1, 1] = curvature
    shift, step = OPTIMUM_2[:2] - OPTIMUM_3[:2], OPTIMUM_2[2] - OPTIMUM_3[2]
    H[:2, 2] = H[2, :2] = -curvature * shift / step
    drop = 2.0 * math.log(RATIO_3 / RATIO_2) / step**2
    H[2, 2] = drop + float(H[:2, 2] @ (H[:2, 2] / curvature))
    return H


def _anchors() -> tuple[Array, Array]:
    """Rows of Table 3 with plausible lift: those at 1.5 m/s and at -10 deg are left out (see the docs)."""
    rows = [r for r in paper_table("table3_lift") if r["U_m_s"] != 1.5 and r["AoA_deg"] >= 0.0]
    points = np.array([[r["F_hz"], r["AoA_deg"], r["U_m_s"]] for r in rows])
    return points, np.array([r["lift_experiment_n"] for r in rows])


@cache
def _fitted() -> tuple[float, float]:
    points, lifts = _anchors()

    def residual(log_curvature: Array) -> Array:
        return np.asarray(np.log(lift(points, np.exp(log_curvature)) / lifts))

    found = least_squares(residual, np.log([2.0 / 15.0**2, 2.0 / 30.0**2]))
    return float(np.exp(found.x[0])), float(np.exp(found.x[1]))


def _curvatures() -> Array:
    return np.array(_fitted())
