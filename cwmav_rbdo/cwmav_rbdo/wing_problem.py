# SPDX-License-Identifier: Apache-2.0
"""The wing study as a problem: best lift-to-power ratio of a clapping wing, met reliably (Eqs. 6, 7, 14)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cwmav_common.errors import InputError
from cwmav_common.settings import setting
from cwmav_rbdo.criteria import CriteriaSettings
from cwmav_rbdo.dispatch import DispatchSettings
from cwmav_rbdo.expressions import compile_function
from cwmav_rbdo.marginals import DISTRIBUTIONS, copula_factor
from cwmav_rbdo.swarm import SwarmSettings
from cwmav_rbdo.window import WindowSettings

Array = NDArray[np.float64]

# Order, unit and factor to SI of the control variables, everywhere (d[3] = [F, AoA, U] of the paper).
CONTROLS: Mapping[str, tuple[str, float]] = {
    "F": ("Hz", 1.0),
    "AoA": ("deg", math.pi / 180.0),
    "U": ("m/s", 1.0),
}
METHODS = ("default", "zhang2026", "classical")
GOALS = ("ratio", "percentile", "least_power")
EVALUATORS = ("ros", "local", "table")
RATIOS = ("propagated", "direct")
OPTIMISERS = ("pyswarms",)


@dataclass(frozen=True)
class DesignVariable:
    """What the optimiser chooses."""

    name: str = setting(..., "name; the wing study knows F [Hz], AoA [deg] and U [m/s]")
    lo: float = setting(..., "lower bound")
    hi: float = setting(..., "upper bound")
    start: float | None = setting(None, "point to begin with, where a method needs one")

    def __post_init__(self) -> None:
        if not self.lo < self.hi:
            raise InputError(f"design variable {self.name}: lo {self.lo:g} is not below hi {self.hi:g}")
        if self.start is not None and not self.lo <= self.start <= self.hi:
            raise InputError(
                f"design variable {self.name}: start {self.start:g} is outside [{self.lo:g}, {self.hi:g}]"
            )


@dataclass(frozen=True)
class Requirement:
    """What the design has to hold (Eqs. 6 and 14); which of the first two, the goal says."""

    lift_to_power: float | None = setting(None, "required lift-to-power ratio R1", unit="N/W", gt=0)
    reliability: float = setting(0.9974, "required probability R0 of holding it", gt=0, lt=1)
    lift: float | None = setting(None, "required lift, the weight in level flight", unit="N", gt=0)


@dataclass(frozen=True)
class SurrogateSettings:
    """How lift, power and ratio are approximated."""

    kernel: str = setting("gaussian", "correlation function", choices=("gaussian", "matern52"))
    trend: str = setting(
        "constant",
        "regression part; auto chooses by leave-one-out",
        choices=("constant", "linear", "quadratic", "auto"),
    )
    ratio: str = setting(
        "propagated",
        "propagated: L/P from the lift and power surrogates with propagated error; direct: a surrogate of "
        "the ratios; or python:package.module:function of your own",
    )

    def __post_init__(self) -> None:
        _check_name("surrogate.ratio", self.ratio, RATIOS)


@dataclass(frozen=True)
class Source:
    """Where local evaluations and measured scatter come from."""

    fidelity: str = setting("table", "lift: 'table', or a preset of the solver for live runs")
    recordings: tuple[str, ...] = setting(
        (), "rig recordings of the power model; none: those bundled with the suite"
    )
    scatter_recording: str = setting("", "recording that the noise is measured on; none: the bundled one")
    topic_map: str = setting("", "topic map of the recordings; none: the suite's own names")
    coarse_lifts: str = setting(
        "",
        "CSV of coarser runs that the lift surrogate also learns from: F_hz, U_m_s, AoA_deg, mean_lift_n, "
        "lift_std_n, dp_m",
    )
    workers: int = setting(1, "live runs at the same time", ge=1, le=256)


@dataclass(frozen=True)
class WingProblem:
    """A wing study; see ``config/two_variables.yaml`` for the paper's."""

    id: str = setting(..., "name of the problem; names the run folder")
    design: tuple[DesignVariable, ...] = setting(..., "design variables, in the order F, AoA, U")
    require: Requirement = setting(..., "requirement on the ratio")  # noqa: RUF009
    kind: str = setting("lift_to_power", "kind of problem", choices=("lift_to_power",))
    title: str = setting("", "one line about it")
    fixed: dict[str, float] = setting({}, "control variables held constant")  # noqa: RUF009
    goal: str = setting(
        "ratio",
        "ratio: largest L/P that meets the requirement; percentile: largest L/P held with the reliability; "
        "least_power: least power whose lift meets the requirement",
        choices=GOALS,
    )
    noise: dict[str, float | str] | None = setting(  # noqa: RUF009
        None, "standard deviations, numbers or formulas of F, AoA, U; None: measured on the rig"
    )
    distribution: dict[str, str] = setting(  # noqa: RUF009
        {},
        f"distribution of a control around its setting, where it is not normal: {', '.join(DISTRIBUTIONS)}",
    )
    corr: tuple[tuple[str, str, float], ...] = setting(
        (), "pairs of controls with their Gaussian copula correlation"
    )
    initial_samples: int = setting(6, "size of the first Latin hypercube", ge=3, le=10000)
    max_iterations: int = setting(20, "iterations after the initial one at most", ge=1, le=1000)
    max_true_evaluations: int = setting(100, "evaluated points at most", ge=4, le=100000)
    method: str = setting(
        "default", f"infill rule: {', '.join(METHODS)}, or python:package.module:function of your own"
    )
    optimiser: str = setting(
        "pyswarms", "what searches on the surrogates, or python:package.module:function of your own"
    )
    batch_size: int = setting(
        0, "new samples of a round of the method default; 0: as many as workers", ge=0, le=1000
    )
    evaluate: str = setting("ros", "who evaluates points", choices=EVALUATORS)
    window: WindowSettings = field(default_factory=WindowSettings)
    criteria: CriteriaSettings = field(default_factory=CriteriaSettings)
    surrogate: SurrogateSettings = field(default_factory=SurrogateSettings)
    swarm: SwarmSettings = field(default_factory=SwarmSettings)
    dispatch: DispatchSettings = field(default_factory=DispatchSettings)
    source: Source = field(default_factory=Source)

    def __post_init__(self) -> None:
        _check_controls(self)
        _check_noise(self)
        _check_shape_of_noise(self)
        _check_goal(self)
        if self.max_true_evaluations <= self.initial_samples:
            raise InputError(
                f"max_true_evaluations {self.max_true_evaluations} leaves nothing after initial_samples "
                f"{self.initial_samples}"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the design variables."""
        return tuple(v.name for v in self.design)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the design variables."""
        return tuple(CONTROLS[name][0] for name in self.names)

    @property
    def lower(self) -> Array:
        """Lower bounds (d,)."""
        return np.array([v.lo for v in self.design])

    @property
    def upper(self) -> Array:
        """Upper bounds (d,)."""
        return np.array([v.hi for v in self.design])

    def control_point(self, x: Array) -> Array:
        """Complete control point (F [Hz], AoA [rad], U [m/s]) of a design `x` (d,) in the problem's units."""
        values = self.fixed | dict(zip(self.names, x.tolist(), strict=True))
        return np.array([values[name] * factor for name, (_, factor) in CONTROLS.items()])

    def named(self, x: Array) -> dict[str, float]:
        """Design as name to value, in the problem's units."""
        return dict(zip(self.names, x.tolist(), strict=True))


def _check_name(key: str, name: str, known: tuple[str, ...]) -> None:
    if name not in known and not name.startswith("python:"):
        raise InputError(f"{key} is '{name}'; allowed: {', '.join(known)}, or python:package.module:function")


def _check_controls(problem: WingProblem) -> None:
    """Every control variable must be chosen or fixed, once, in the agreed order."""
    names = problem.names
    if not names:
        raise InputError("design: no variable; at least one of F, AoA, U is needed")
    for name in (*names, *problem.fixed):
        if name not in CONTROLS:
            raise InputError(f"'{name}' is no control variable; allowed: {', '.join(CONTROLS)}")
    if list(names) != [name for name in CONTROLS if name in names]:
        raise InputError(f"design: {', '.join(names)}; expected each once, in the order F, AoA, U")
    for name in CONTROLS:
        if (name in names) == (name in problem.fixed):
            where = "both in design and in fixed" if name in names else "neither in design nor in fixed"
            raise InputError(f"{name} is {where}; it must be in exactly one of them")


def _check_goal(problem: WingProblem) -> None:
    """Check that the goal finds the requirement it is about, and the method's name."""
    _check_name("method", problem.method, METHODS)
    _check_name("optimiser", problem.optimiser, OPTIMISERS)
    if problem.goal == "ratio" and problem.require.lift_to_power is None:
        raise InputError("require.lift_to_power is missing; goal ratio needs it, in N/W")
    if problem.goal == "least_power":
        if problem.require.lift is None:
            raise InputError("require.lift is missing; goal least_power needs it, in N")
        if problem.surrogate.ratio != "propagated":
            raise InputError(
                f"surrogate.ratio is '{problem.surrogate.ratio}'; goal least_power needs 'propagated'"
            )
    if problem.source.coarse_lifts and problem.surrogate.ratio != "propagated":
        raise InputError("source.coarse_lifts needs surrogate.ratio 'propagated': they are lifts, not ratios")
    if problem.goal == "percentile" and problem.require.reliability <= 0.5:
        raise InputError(
            f"require.reliability is {problem.require.reliability:g}; goal percentile needs more than 0.5"
        )


def _check_noise(problem: WingProblem) -> None:
    if problem.noise is None:
        return
    for name, std in problem.noise.items():
        if name not in CONTROLS:
            raise InputError(f"noise: '{name}' is no control variable; allowed: {', '.join(CONTROLS)}")
        if isinstance(std, str):
            compile_function(std, CONTROLS, f"noise: {name}")
        elif not (math.isfinite(std) and std >= 0):
            raise InputError(
                f"noise: {name} is {std!r}; allowed: a standard deviation >= 0 or a formula of F, AoA, U"
            )
    missing = [name for name in CONTROLS if name not in problem.noise]
    if missing:
        raise InputError(
            f"noise: {', '.join(missing)} is missing; give F [Hz], AoA [deg] and U [m/s], or 'measured'"
        )


def _check_shape_of_noise(problem: WingProblem) -> None:
    """Check distributions and correlations."""
    for name, dist in problem.distribution.items():
        if name not in CONTROLS or dist not in DISTRIBUTIONS:
            raise InputError(
                f"distribution: {name} is '{dist}'; expected F, AoA or U with one of "
                f"{', '.join(DISTRIBUTIONS)}"
            )
    for variable in problem.design:
        if problem.distribution.get(variable.name) == "lognormal" and variable.lo <= 0.0:
            raise InputError(
                f"distribution: {variable.name} is 'lognormal', which needs positive values; its lo is "
                f"{variable.lo:g}"
            )
    copula_factor(tuple(CONTROLS), problem.corr)
