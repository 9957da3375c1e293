# SPDX-License-Identifier: Apache-2.0
"""The bundled lift table: SPH runs of this solver over the design space, interpolated.

A Gaussian process is fitted to the runs (scikit-learn). Its mean between the runs rests on a trend of the
products that aerodynamic force is made of: squares of airspeed and stroke speed, and their product, times
odd and even functions of the angle of attack.
"""

from __future__ import annotations

import csv
import math
import warnings
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np
from scipy.linalg import solve_triangular
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from cwmav_common.errors import InputError
from cwmav_sim.wing.sheet import FloatArray

_FILE = "lift_table.csv"
_NUMBERS = ("F_hz", "AoA_deg", "U_m_s", "mean_lift_n", "lift_std_n", "dp_m")
_TEXTS = ("preset", "version", "solver", "address", "half_model", "periodic", "cycles")
_LIMITS = (("F", 4.0, 30.0, "Hz"), ("AoA", -10.0, 60.0, "deg"), ("U", 0.0, 6.0, "m/s"))


@dataclass(frozen=True)
class LiftEstimate:
    """Lift at one point from the table.

    Attributes
    ----------
    lift, lift_std : float
        Mean lift and its standard uncertainty [N]: interpolation and scatter between cycles, not the
        error of the particle spacing.
    source : str
        Where the number comes from.
    inside : bool
        Whether the point lies within the ranges the runs cover.
    """

    lift: float
    lift_std: float
    source: str
    inside: bool


@dataclass(frozen=True)
class TableRows:
    """Runs behind a table; arrays of n rows."""

    points: FloatArray  # (n, 3): F [Hz], AoA [rad], U [m/s]
    lift: FloatArray  # (n,) N
    lift_std: FloatArray  # (n,) N
    preset: str
    dp: float
    half_model: bool
    version: str
    solver: str


class LiftTable:
    """Gaussian process over stored SPH runs.

    Parameters
    ----------
    rows : TableRows
        The runs; at least eight.

    Attributes
    ----------
    loo_rms : float
        Root mean square of the leave-one-out errors [N].
    loo_errors : ndarray, shape (n,)
        Prediction without the row minus the row [N].
    """

    def __init__(self, rows: TableRows) -> None:
        if len(rows.lift) < 8:
            raise InputError(f"lift table: {len(rows.lift)} rows; needed: at least 8")
        self.rows = rows
        self._low, self._high = rows.points.min(axis=0), rows.points.max(axis=0)
        self._model = _Surrogate.fit(rows.points, rows.lift, rows.lift_std)
        self.loo_errors, scores = _leave_one_out(self._model, rows)
        self.loo_rms = float(np.sqrt(np.mean(self.loo_errors**2)))
        # The process may be too sure of itself; its errors on left-out runs say by how much.
        self._inflation = max(1.0, float(np.sqrt(np.mean(scores**2))))

    @classmethod
    @cache
    def bundled(cls) -> LiftTable:
        """Return the table shipped with the package."""
        return cls.load(Path(str(resources.files("cwmav_sim") / "data" / _FILE)))

    @classmethod
    def load(cls, path: str | Path) -> LiftTable:
        """Read a table written by a sweep; see :func:`read_rows` for the errors."""
        return cls(read_rows(path))

    @property
    def source(self) -> str:
        """Say what the table is made of."""
        rows = self.rows
        model = "half model" if rows.half_model else "full model"
        return (
            f"lift table: {len(rows.lift)} SPH runs at {1e3 * rows.dp:g} mm, {model}, preset {rows.preset}, "
            f"version {rows.version}, solver {rows.solver}, leave-one-out error {1e3 * self.loo_rms:.1f} mN"
        )

    def lift(self, flapping_frequency: float, angle_of_attack: float, airspeed: float) -> LiftEstimate:
        """Interpolate the lift.

        Parameters
        ----------
        flapping_frequency, angle_of_attack, airspeed : float
            Operating point [Hz, rad, m/s].

        Raises
        ------
        InputError
            When the point lies outside 4..30 Hz, -10..60 deg, 0..6 m/s.
        """
        point = np.array([flapping_frequency, angle_of_attack, airspeed])
        _check_limits(point)
        mean, std = self._model.predict(point[None, :])
        inside = bool(np.all(point >= self._low - 1e-9) and np.all(point <= self._high + 1e-9))
        return LiftEstimate(float(mean[0]), self._inflation * float(std[0]), self.source, inside)


@dataclass(frozen=True)
class _Surrogate:
    """Trend by least squares and a Gaussian process on what is left.

    The standard deviation is that of universal Kriging: what the process does not know, and what the runs
    leave open about the trend, which counts most outside of them.
    """

    trend: FloatArray
    process: GaussianProcessRegressor
    scale: float
    whitened: FloatArray  # L^-1 B, shape (n, terms): basis of the runs in units of their covariance L L'

    @classmethod
    def fit(
        cls, points: FloatArray, lift: FloatArray, lift_std: FloatArray, kernel: object | None = None
    ) -> _Surrogate:
        """Fit to the rows; a given ``kernel`` is kept as it is."""
        basis = _basis(points)
        trend = np.linalg.lstsq(basis, lift, rcond=None)[0]
        residual = lift - basis @ trend
        scale = float(np.std(residual)) or 1.0
        process = GaussianProcessRegressor(
            kernel or _start_kernel(),
            alpha=(np.nan_to_num(lift_std) / scale) ** 2 + 1e-8,
            optimizer="fmin_l_bfgs_b" if kernel is None else None,
            n_restarts_optimizer=4 if kernel is None else 0,
            random_state=0,
        )
        with warnings.catch_warnings():
            # A hyperparameter may rest on its bound: few runs cannot tell a long length from a longer one.
            warnings.simplefilter("ignore", ConvergenceWarning)
            process.fit(_scaled(points), residual / scale)
        whitened = solve_triangular(process.L_, basis, lower=True)
        return cls(np.asarray(trend, dtype=np.float64), process, scale, np.asarray(whitened))

    def predict(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation [N], shape (n,) each."""
        scaled, basis = _scaled(points), _basis(points)
        mean, std = self.process.predict(scaled, return_std=True)
        covariance = self.process.kernel_(scaled, self.process.X_train_)
        seen = solve_triangular(self.process.L_, covariance.T, lower=True)
        unseen = basis.T - self.whitened.T @ seen
        information = np.linalg.cholesky(self.whitened.T @ self.whitened)
        open_trend = np.sum(solve_triangular(information, unseen, lower=True) ** 2, axis=0)
        return basis @ self.trend + self.scale * mean, self.scale * np.sqrt(std**2 + open_trend)


def _start_kernel() -> object:
    smooth = ConstantKernel(1.0, (1e-2, 1e2)) * Matern([1.0, 1.0, 1.0], (0.2, 20.0), nu=2.5)
    return smooth + WhiteKernel(0.05, (1e-4, 2.0))


def _scaled(points: FloatArray) -> FloatArray:
    """Design space on about unit size."""
    scaled: FloatArray = points / np.array([10.0, 0.5, 2.0])
    return scaled


def _basis(points: FloatArray) -> FloatArray:
    """Products that aerodynamic force is made of: (U^2, F U, F^2) times sine and cosine of AoA."""
    frequency, angle, speed = points[:, 0] / 16.0, points[:, 1], points[:, 2] / 3.5
    sine, cosine = np.sin(angle), np.cos(angle)
    terms = [
        speed**2 * sine * cosine,
        speed * frequency * sine,
        frequency**2 * sine,
        speed**2 * cosine**2,
        speed * frequency * cosine,
        frequency**2 * cosine,
    ]
    return np.column_stack(terms)


def _leave_one_out(model: _Surrogate, rows: TableRows) -> tuple[FloatArray, FloatArray]:
    """Errors at every row predicted from the others, plain [N] and over their predicted deviation."""
    errors, scores = [], []
    for k in range(len(rows.lift)):
        keep = np.arange(len(rows.lift)) != k
        part = _Surrogate.fit(
            rows.points[keep], rows.lift[keep], rows.lift_std[keep], kernel=model.process.kernel_
        )
        mean, std = part.predict(rows.points[k : k + 1])
        errors.append(float(mean[0] - rows.lift[k]))
        scores.append(errors[-1] / math.hypot(float(std[0]), float(np.nan_to_num(rows.lift_std[k]))))
    return np.array(errors), np.array(scores)


def read_rows(path: str | Path) -> TableRows:
    """Read the runs of a table.

    Raises
    ------
    InputError
        Names the file and what is wrong: unreadable, a missing column, a value that is no number, or
        rows of different presets or solvers, which must not be mixed.
    """
    try:
        with Path(path).open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            missing = [name for name in (*_NUMBERS, *_TEXTS) if name not in (reader.fieldnames or [])]
            if missing:
                raise InputError(f"{path}: column {', '.join(missing)} is missing")
            rows = list(reader)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    for name in ("preset", "solver", "version", "dp_m", "half_model"):
        kinds = sorted({row[name] for row in rows})
        if len(kinds) != 1:
            raise InputError(
                f"{path}: {name} must be the same in all rows; found {', '.join(kinds) or 'none'}"
            )
    try:
        data = np.array([[float(row[name]) for name in _NUMBERS] for row in rows])
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    first = rows[0]
    points = np.column_stack([data[:, 0], np.radians(data[:, 1]), data[:, 2]])
    return TableRows(
        points,
        data[:, 3],
        data[:, 4],
        first["preset"],
        float(data[0, 5]),
        first["half_model"] == "True",
        first["version"],
        first["solver"],
    )


def _check_limits(point: FloatArray) -> None:
    values = (point[0], math.degrees(point[1]), point[2])
    for value, (name, low, high, unit) in zip(values, _LIMITS, strict=True):
        if not low - 1e-9 <= value <= high + 1e-9:
            raise InputError(f"{name} is {value:g} {unit}; allowed: {low:g} to {high:g} {unit}")
