# SPDX-License-Identifier: Apache-2.0
"""ROS parameters from settings dataclasses: declared, described, limited and validated from one place."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Collection, Sequence
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from cwmav_common.errors import InputError
from cwmav_common.settings import SettingDescription, describe, from_mapping

T = TypeVar("T")


class Parameters(Generic[T]):
    """The settings of a node as its parameters.

    A change is validated as a whole before any of it is accepted, and refused with the reason. ``value`` is
    always one consistent, frozen set.

    Parameters
    ----------
    node : who declares
    cls : frozen dataclass of settings with defaults
    read_only : keys that only a restart can change
    check : further validation of a complete set; raises InputError
    on_change : called with the new set once it is accepted

    Raises
    ------
    InputError
        A start value (from a parameter file or the command line) is not allowed.
    """

    def __init__(
        self,
        node: Node,
        cls: type[T],
        *,
        read_only: Collection[str] = (),
        check: Callable[[T], None] = lambda value: None,
        on_change: Callable[[T], None] = lambda value: None,
    ) -> None:
        self._node, self._cls, self._check, self._on_change = node, cls, check, on_change
        self._keys = [item.key for item in describe(cls)]
        for item in describe(cls):
            descriptor = _descriptor(item, item.key in read_only)
            try:
                node.declare_parameter(item.key, _plain(item.default), descriptor)
            except (InvalidParameterTypeException, InvalidParameterValueException) as error:
                raise InputError(
                    f"parameter {item.key}: {error}; allowed: {item.allowed() or item.type.__name__}"
                ) from None
        self.value: T = self._build({})
        check(self.value)
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._accept)

    def _build(self, changes: dict[str, Any]) -> T:
        values = {key: self._node.get_parameter(key).value for key in self._keys} | changes
        return from_mapping(
            self._cls, _nest(values), source=f"{self._node.get_fully_qualified_name()} parameter"
        )

    def _validate(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        changes = {p.name: p.value for p in parameters if p.name in self._keys}
        if not changes:
            return SetParametersResult(successful=True)
        try:
            self._check(self._build(changes))
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _accept(self, parameters: Sequence[Parameter]) -> None:
        if any(p.name in self._keys for p in parameters):
            self.value = self._build({})
            self._on_change(self.value)


def _descriptor(item: SettingDescription, read_only: bool) -> ParameterDescriptor:
    unit = f" [{item.unit}]" if item.unit else ""
    descriptor = ParameterDescriptor(
        name=item.key,
        description=f"{item.description}{unit}",
        additional_constraints=item.allowed() if item.choices or item.limits else "",
        read_only=read_only,
    )
    if item.limits:
        low = item.limits.get("ge", item.limits.get("gt"))
        high = item.limits.get("le", item.limits.get("lt"))
        if item.type is int:
            descriptor.integer_range = [
                IntegerRange(
                    from_value=-(2**63) if low is None else int(low),
                    to_value=2**63 - 1 if high is None else int(high),
                    step=1,
                )
            ]
        elif item.type is float:
            largest = sys.float_info.max
            descriptor.floating_point_range = [
                FloatingPointRange(
                    from_value=-largest if low is None else float(low),
                    to_value=largest if high is None else float(high),
                )
            ]
    return descriptor


def _plain(value: Any) -> Any:
    if value is dataclasses.MISSING:
        raise TypeError("settings of a node need defaults")
    return list(value) if isinstance(value, tuple) else value


def _nest(values: dict[str, Any]) -> dict[str, Any]:
    nested: dict[str, Any] = {}
    for key, value in values.items():
        *path, last = key.split(".")
        level = nested
        for part in path:
            level = level.setdefault(part, {})
        level[last] = value
    return nested
