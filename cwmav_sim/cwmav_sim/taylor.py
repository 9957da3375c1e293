# SPDX-License-Identifier: Apache-2.0
"""Truncated Taylor series in time, so that position, rate and acceleration always agree.

A series holds the coefficients c_k of f(t0 + s) = sum_k c_k s^k; the k-th derivative is k! c_k.
The recurrences are those of automatic differentiation (Griewank & Walther, Evaluating Derivatives,
2nd ed. 2008, chapter 13).
"""

from __future__ import annotations

import math
from collections.abc import Sequence


class Taylor:
    """A scalar function of time known to a fixed order about one instant.

    Parameters
    ----------
    coefficients : sequence of float
        c_0 .. c_N.
    """

    __slots__ = ("c",)

    def __init__(self, coefficients: Sequence[float]) -> None:
        self.c = list(coefficients)

    @classmethod
    def time(cls, t: float, order: int) -> Taylor:
        """Return the series of time itself about ``t``."""
        return cls([t, 1.0] + [0.0] * (order - 1))

    @property
    def order(self) -> int:
        """Highest power kept."""
        return len(self.c) - 1

    def derivative(self, k: int) -> float:
        """Return the value of the k-th derivative."""
        return math.factorial(k) * self.c[k]

    def rate(self) -> Taylor:
        """Return the series of the time derivative, one order shorter."""
        return Taylor([k * self.c[k] for k in range(1, len(self.c))])

    def truncated(self, order: int) -> Taylor:
        """Return the same series kept to a lower order."""
        return Taylor(self.c[: order + 1])

    def __add__(self, other: Taylor | float) -> Taylor:
        if isinstance(other, Taylor):
            return Taylor([a + b for a, b in zip(self.c, other.c, strict=True)])
        return Taylor([self.c[0] + other, *self.c[1:]])

    __radd__ = __add__

    def __neg__(self) -> Taylor:
        return Taylor([-a for a in self.c])

    def __sub__(self, other: Taylor | float) -> Taylor:
        return self + (-other)

    def __rsub__(self, other: float) -> Taylor:
        return -self + other

    def __mul__(self, other: Taylor | float) -> Taylor:
        if not isinstance(other, Taylor):
            return Taylor([a * other for a in self.c])
        n = len(self.c)
        return Taylor([sum(self.c[j] * other.c[k - j] for j in range(k + 1)) for k in range(n)])

    __rmul__ = __mul__

    def __truediv__(self, other: Taylor | float) -> Taylor:
        if not isinstance(other, Taylor):
            return self * (1.0 / other)
        out: list[float] = []
        for k in range(len(self.c)):
            known = sum(out[j] * other.c[k - j] for j in range(k))
            out.append((self.c[k] - known) / other.c[0])
        return Taylor(out)


def sin_cos(u: Taylor) -> tuple[Taylor, Taylor]:
    """Return the series of sin(u) and cos(u)."""
    s, c = [math.sin(u.c[0])], [math.cos(u.c[0])]
    for k in range(1, len(u.c)):
        s.append(sum(j * u.c[j] * c[k - j] for j in range(1, k + 1)) / k)
        c.append(-sum(j * u.c[j] * s[k - j] for j in range(1, k + 1)) / k)
    return Taylor(s), Taylor(c)


def power(u: Taylor, exponent: float) -> Taylor:
    """Return the series of ``u ** exponent`` for u > 0."""
    out = [u.c[0] ** exponent]
    for k in range(1, len(u.c)):
        total = sum((exponent * j - (k - j)) * u.c[j] * out[k - j] for j in range(1, k + 1))
        out.append(total / (k * u.c[0]))
    return Taylor(out)


def bounded(u: Taylor, limit: Taylor | float, sharpness: int = 4) -> Taylor:
    """Return ``u`` limited smoothly to +-``limit`` (> 0).

    u / (1 + (u/limit)^n)^(1/n) with even n: close to u when small, to the limit when large, and with
    as many continuous derivatives as its arguments.
    """
    ratio = u / limit
    raised = ratio * ratio
    for _ in range(sharpness // 2 - 1):
        raised = raised * (ratio * ratio)
    return u * power(raised + 1.0, -1.0 / sharpness)
