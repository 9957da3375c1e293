# SPDX-License-Identifier: Apache-2.0
"""Electrical power between the recorded operating points: a Gaussian process with its uncertainty.

The logarithm of power is regressed, because power spans a decade and its scatter grows with it. Each point
enters with the standard uncertainty of its mean. A request outside of the convex hull of the points is
answered, and marked as such.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from cwmav_common.errors import InputError
from cwmav_rig.analysis import RigReport, analyse
from cwmav_rig.topic_map import TopicMap

Array = NDArray[np.float64]

FORMAT = "cwmav power model"
LEAST_POINTS = 4
_BUNDLED = {"physical": "power_model.json", "paper_law": "power_model_paper_law.json"}
# Spans of the paper's design space (Eq. 7): they make distances in F [Hz], AoA [rad] and U [m/s] comparable.
SCALE = np.array([26.0, np.radians(70.0), 6.0])
FLAT = 0.03  # points that spread less than this share of a span are taken to lie at one value
_HYPERPARAMETERS = 5  # variance, three length scales, noise
_JITTER = 1e-3  # relative; power readings agree no better than this from one recording to another


@dataclass(frozen=True)
class OperatingPoint:
    """Power at one setting: F [Hz], AoA [rad], U [m/s], mean power and its standard uncertainty [W]."""

    flapping_frequency: float
    angle_of_attack: float
    airspeed: float
    power: float
    power_std: float
    source: str = ""
    origin: str = "measured"


@dataclass(frozen=True)
class PowerEstimate:
    """Answer at one setting; `inside` says whether it lies among the measured points."""

    power: float
    power_std: float
    inside: bool
    source: str


class PowerModel:
    """Surrogate of electrical power over (F, AoA, U).

    Parameters
    ----------
    points
        At least four operating points.
    kernel
        Logarithms of the hyperparameters of a model of the same points; fitted when not given.

    Raises
    ------
    InputError
        Too few points, or a power that is not positive.
    """

    def __init__(self, points: Sequence[OperatingPoint], kernel: Sequence[float] | None = None) -> None:
        if len(points) < LEAST_POINTS:
            raise InputError(
                f"power model: {len(points)} operating points; at least {LEAST_POINTS} are needed"
            )
        for point in points:
            if not point.power > 0.0:
                raise InputError(
                    f"power model: power {point.power:g} W of {point.source or 'a point'} must be positive"
                )
        self.points = tuple(points)
        self._x = np.array([[p.flapping_frequency, p.angle_of_attack, p.airspeed] for p in points]) / SCALE
        log_power = np.log([p.power for p in points])
        noise = np.array([np.nan_to_num(p.power_std, nan=0.05 * p.power) / p.power for p in points])
        self._offset = float(log_power.mean())
        self._process = self._fitted(log_power - self._offset, noise, kernel)
        self._hull = _Hull(self._x)

    @classmethod
    def from_recordings(cls, paths: Sequence[str | Path], topic_map: TopicMap | None = None) -> PowerModel:
        """Analyse recordings, or folders of recordings, and build the model of their operating points.

        Raises
        ------
        InputError
            A recording cannot be analysed or lacks power, angle or wind.
        """
        return cls([operating_point(analyse(path, topic_map)) for path in find_recordings(paths)])

    @classmethod
    def bundled(cls, model: str = "physical") -> PowerModel:
        """Give the model of the synthetic campaign that comes with the package.

        Parameters
        ----------
        model
            ``physical``, or ``paper_law``: the empirical law that has the optima of the paper's Tables 5, 6.
        """
        if model not in _BUNDLED:
            raise InputError(f"bundled power model {model!r}; allowed: {', '.join(_BUNDLED)}")
        return cls.load(Path(str(resources.files("cwmav_rig") / "data" / _BUNDLED[model])))

    @classmethod
    def load(cls, path: str | Path) -> PowerModel:
        """Read the operating points from a file that :meth:`save` wrote.

        Raises
        ------
        InputError
            The file cannot be read or is something else.
        """
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
            if content["format"] != FORMAT:
                raise KeyError("format")
            points = [OperatingPoint(**point) for point in content["points"]]
            kernel = [float(value) for value in content["kernel"]]
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: is no {FORMAT} file ({type(error).__name__}: {error})") from None
        if len(kernel) != _HYPERPARAMETERS:
            raise InputError(f"{path}: kernel has {len(kernel)} values, {_HYPERPARAMETERS} expected")
        return cls(points, kernel)

    def save(self, path: str | Path) -> None:
        """Write the operating points and the hyperparameters that were fitted to them."""
        content: dict[str, Any] = {
            "format": FORMAT,
            "kernel": self._process.kernel_.theta.tolist(),
            "points": [asdict(point) for point in self.points],
        }
        Path(path).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")

    def predict(self, flapping_frequency: float, angle_of_attack: float, airspeed: float) -> PowerEstimate:
        """Answer at one setting: F [Hz], AoA [rad], U [m/s]."""
        x = np.array([[flapping_frequency, angle_of_attack, airspeed]]) / SCALE
        if not np.isfinite(x).all():
            raise InputError(
                f"power model: F {flapping_frequency} Hz, AoA {angle_of_attack} rad, U {airspeed} m/s;"
                " they must be finite"
            )
        mean, std = self._process.predict(x, return_std=True)
        power = float(np.exp(mean[0] + self._offset))
        inside = self._hull.holds(x[0])
        return PowerEstimate(power, power * float(std[0]), inside, self._describe(inside))

    def leave_one_out(self) -> Array:
        """Relative error of the prediction at every point from the others, (n,), the kernel kept."""
        process = self._process
        inverse = np.linalg.inv(process.L_ @ process.L_.T)
        # Sundararajan & Keerthi (2001): residual of the left-out point in closed form.
        return np.asarray(np.expm1(-(inverse @ process.y_train_) / np.diag(inverse)))

    def _fitted(
        self, y: Array, noise: Array, hyperparameters: Sequence[float] | None
    ) -> GaussianProcessRegressor:
        kernel = ConstantKernel(1.0, (1e-3, 1e3)) * Matern([0.5] * 3, (0.05, 50.0), nu=2.5) + WhiteKernel(
            1e-5, (1e-8, 1e-2)
        )
        process = GaussianProcessRegressor(
            kernel, alpha=noise**2 + _JITTER**2, n_restarts_optimizer=1, random_state=0
        )
        if hyperparameters is not None:
            process.set_params(kernel=kernel.clone_with_theta(np.array(hyperparameters)), optimizer=None)
        with warnings.catch_warnings():
            # A length scale at its bound means that power does not depend on that control, which is right.
            warnings.simplefilter("ignore", ConvergenceWarning)
            return process.fit(self._x, y)

    def _describe(self, inside: bool) -> str:
        origins = ", ".join(sorted({point.origin for point in self.points}))
        place = "" if inside else "; outside of the measured region"
        return f"power surrogate of {len(self.points)} recordings ({origins}){place}"


def operating_point(report: RigReport) -> OperatingPoint:
    """Take the operating point out of a report.

    Raises
    ------
    InputError
        Frequency, angle, wind or power is missing in the recording.
    """
    found = {
        "flapping frequency": report.flapping_frequency,
        "angle of attack": report.angle_of_attack,
        "wind": report.airspeed,
        "power": report.power,
    }
    missing = [name for name, spread in found.items() if spread is None]
    if missing:
        raise InputError(f"{report.source}: no {' and no '.join(missing)}; a power model needs all four")
    f, a, u, p = (spread for spread in found.values() if spread is not None)
    return OperatingPoint(f.mean, a.mean, u.mean, p.mean, p.mean_std, Path(report.source).name, report.origin)


def find_recordings(paths: Sequence[str | Path]) -> list[Path]:
    """Expand folders that hold several recordings.

    Raises
    ------
    InputError
        A path does not exist or holds no recording.
    """
    found: list[Path] = []
    for entry in map(Path, paths):
        if not entry.exists():
            raise InputError(f"{entry}: no such recording or folder")
        if entry.is_file() or (entry / "metadata.yaml").exists():
            found.append(entry)
            continue
        inside = [p for p in sorted(entry.iterdir()) if p.suffix == ".mcap" or (p / "metadata.yaml").exists()]
        if not inside:
            raise InputError(f"{entry}: holds no recording (.mcap file or rosbag2 folder)")
        found += inside
    return found


class _Hull:
    """Convex hull of points that may lie in a plane or on a line."""

    def __init__(self, points: Array) -> None:
        self._centre = points.mean(axis=0)
        _, _, directions = np.linalg.svd(points - self._centre, full_matrices=True)
        along = (points - self._centre) @ directions.T
        extent = np.ptp(along, axis=0)
        self._directions = directions
        self._wide = extent > FLAT
        self._low, self._high = along.min(axis=0), along.max(axis=0)
        self._simplices: Delaunay | None = None
        if self._wide.sum() > 1:
            try:
                self._simplices = Delaunay(along[:, self._wide])
            except QhullError:
                self._simplices = None

    def holds(self, x: Array) -> bool:
        # A request on the rim counts as inside: recorded settings wander by as much.
        along = (1.0 - FLAT) * (x - self._centre) @ self._directions.T
        flat = ~self._wide
        near = (along >= self._low - FLAT) & (along <= self._high + FLAT)
        if not near[flat].all():
            return False
        if self._simplices is None:
            return bool(near.all())
        return bool(self._simplices.find_simplex(along[self._wide], tol=1e-6) >= 0)
