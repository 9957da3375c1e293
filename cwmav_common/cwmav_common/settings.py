# SPDX-License-Identifier: Apache-2.0
"""Settings declared once, as frozen dataclasses, and used everywhere.

A field made by :func:`setting` carries its default, unit, limits and description. From that one declaration
come YAML files, ``--set key=value`` overrides, ROS parameters and the tables of the documentation. Validation
is pydantic's; its reports become one line that names the source, the key, the value and what is allowed.
"""

from __future__ import annotations

import dataclasses
import functools
import operator
import re
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, cast

import pydantic
import yaml

from cwmav_common.errors import InputError

T = TypeVar("T")
_LIMITS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


@dataclass(frozen=True)
class SettingDescription:
    """One setting as a person reads it; `limits` holds any of gt, ge, lt, le."""

    key: str
    type: type
    default: Any
    unit: str
    description: str
    limits: Mapping[str, float]
    choices: tuple[str, ...]

    def allowed(self) -> str:
        """Say in words what values are allowed."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        bounds = " and ".join(f"{_LIMITS[name]} {bound:g}" for name, bound in self.limits.items())
        unit = f" {self.unit}" if self.unit and bounds else ""
        return f"{self.type.__name__} {bounds}{unit}".strip()


def setting(
    default: Any,
    description: str,
    *,
    unit: str = "",
    gt: float | None = None,
    ge: float | None = None,
    lt: float | None = None,
    le: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    """Declare one field of a settings dataclass; a default of ``...`` makes it required."""
    limits = {
        name: bound for name, bound in (("gt", gt), ("ge", ge), ("lt", lt), ("le", le)) if bound is not None
    }
    metadata = {"description": description, "unit": unit, "limits": limits, "choices": tuple(choices)}
    if default is ...:
        return dataclasses.field(metadata=metadata)
    if isinstance(default, list | dict | set):
        return dataclasses.field(default_factory=lambda: default, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def from_mapping(cls: type[T], mapping: Mapping[str, Any], source: str = "settings") -> T:
    """Build `cls` from nested plain values.

    Raises
    ------
    InputError
        Names `source`, the key, the value and what is allowed.
    """
    if not isinstance(mapping, Mapping):
        raise InputError(f"{source}: expected keys and values, found {type(mapping).__name__}")
    try:
        model = _model(cast(Any, cls)).model_validate(dict(mapping))
    except pydantic.ValidationError as error:
        raise InputError(f"{source}: {_explain(cls, error)}") from None
    try:
        built: T = _build(cls, model)
    except ValueError as error:  # a check across fields in __post_init__
        if str(error).startswith(source):
            raise
        raise InputError(f"{source}: {error}") from None
    return built


def load_yaml(cls: type[T], path: str | Path) -> T:
    """Read `cls` from a YAML (or JSON) file.

    Raises
    ------
    InputError
        The file cannot be read, is no YAML, or holds a key or value that is not allowed.
    """
    return from_mapping(cls, read_yaml(path), source=str(path))


def read_yaml(path: str | Path) -> dict[str, Any]:
    """Read a YAML mapping; see :func:`load_yaml` for the errors."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    try:
        content = yaml.load(text, Loader=_YAML12FloatLoader)  # noqa: S506 - a SafeLoader
    except yaml.YAMLError as error:
        raise InputError(f"{path}: is not valid YAML ({' '.join(str(error).split())})") from None
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected keys and values at the top, found {type(content).__name__}")
    return content


def to_mapping(settings: Any) -> dict[str, Any]:
    """Give the nested plain values of a settings dataclass, ready for YAML or JSON."""
    values: dict[str, Any] = {}
    for field in dataclasses.fields(settings):
        values[field.name] = _plain(getattr(settings, field.name))
    return values


def override(settings: T, assignments: Iterable[str], source: str = "--set") -> T:
    """Apply ``a.b=value`` assignments, the values read as YAML, and validate the result again."""
    mapping = to_mapping(settings)
    for assignment in assignments:
        key, separator, text = assignment.partition("=")
        if not separator:
            raise InputError(f"{source} {assignment}: expected key=value")
        value = yaml.load(text, Loader=_YAML12FloatLoader)  # noqa: S506 - a SafeLoader
        _assign(mapping, key.strip(), value, f"{source} {assignment}")
    return from_mapping(type(settings), mapping, source)


def describe(cls: type, prefix: str = "") -> list[SettingDescription]:
    """List every setting of `cls`, nested ones with dotted keys."""
    return list(_describe(cls, prefix))


def markdown_table(cls: type) -> str:
    """Render :func:`describe` as the table that the documentation shows."""
    rows = ["| setting | default | unit | allowed | meaning |", "| --- | --- | --- | --- | --- |"]
    for item in describe(cls):
        default = "required" if item.default is dataclasses.MISSING else f"`{item.default}`"
        default = "empty" if item.default == "" else default
        rows.append(f"| `{item.key}` | {default} | {item.unit} | {item.allowed()} | {item.description} |")
    return "\n".join(rows)


class _YAML12FloatLoader(yaml.SafeLoader):
    """SafeLoader that reads `1e6` and `2.0e-4` as numbers, as YAML 1.2 and every person does."""


_YAML12FloatLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+$"),
    list("-+0123456789."),
)


@functools.cache
def _hints(cls: Any) -> dict[str, Any]:
    return typing.get_type_hints(cls, include_extras=True)


@functools.cache
def _model(cls: Any) -> type[pydantic.BaseModel]:
    fields: dict[str, Any] = {}
    for field in dataclasses.fields(cls):
        annotation = _annotation(_hints(cls)[field.name], field)
        if field.default is not dataclasses.MISSING:
            fields[field.name] = (annotation, field.default)
        elif field.default_factory is not dataclasses.MISSING:
            fields[field.name] = (
                annotation,
                pydantic.Field(default_factory=_plain_factory(annotation, field)),
            )
        else:
            fields[field.name] = (annotation, ...)
    config = pydantic.ConfigDict(extra="forbid", allow_inf_nan=False)
    return pydantic.create_model(cls.__name__, __config__=config, **fields)


def _plain_factory(annotation: Any, field: dataclasses.Field[Any]) -> Callable[[], Any]:
    adapter = pydantic.TypeAdapter(annotation)
    factory = cast(Callable[[], Any], field.default_factory)
    return lambda: adapter.validate_python(_plain(factory()))


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return to_mapping(value)
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _annotation(hint: Any, field: dataclasses.Field[Any]) -> Any:
    choices = field.metadata.get("choices")
    if choices:
        return Literal[choices] | None if _is_optional(hint) else Literal[choices]
    limits = field.metadata.get("limits")
    return _constrained(hint, pydantic.Field(**limits)) if limits else _replace_dataclasses(hint)


def _constrained(hint: Any, limits: Any) -> Any:
    """Attach limits; on ``X | None`` they bind the X only."""
    if _is_optional(hint):
        return _constrained(_without_none(hint), limits) | None
    return Annotated[hint, limits]


def _without_none(hint: Any) -> Any:
    return functools.reduce(operator.or_, (m for m in typing.get_args(hint) if m is not types.NoneType))


def _is_optional(hint: Any) -> bool:
    return typing.get_origin(hint) in (Union, types.UnionType) and types.NoneType in typing.get_args(hint)


def _replace_dataclasses(hint: Any) -> Any:
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        return _model(hint)
    if typing.get_origin(hint) is tuple:
        return tuple.__class_getitem__(tuple(_replace_dataclasses(a) for a in typing.get_args(hint)))
    return hint


def _build(cls: Any, model: Any) -> Any:
    values = {field.name: _value(getattr(model, field.name)) for field in dataclasses.fields(cls)}
    hints = _hints(cls)
    for name, value in values.items():
        nested = hints[name]
        if isinstance(value, pydantic.BaseModel):
            values[name] = _build(nested, value)
        elif isinstance(value, tuple) and any(isinstance(v, pydantic.BaseModel) for v in value):
            member = typing.get_args(nested)[0]
            values[name] = tuple(_build(member, v) if isinstance(v, pydantic.BaseModel) else v for v in value)
    return cls(**values)


def _value(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _explain(cls: type, error: pydantic.ValidationError) -> str:
    known = {item.key: item for item in describe(cls)}
    sentences = []
    for issue in error.errors():
        key = ".".join(str(part) for part in issue["loc"])
        if issue["type"] == "extra_forbidden":
            level = key.rpartition(".")[0]
            names = sorted(
                {k[len(level) :].lstrip(".").partition(".")[0] for k in known if k.startswith(level)}
            )
            sentences.append(f"unknown key '{key}'; allowed here: {', '.join(names)}")
        elif issue["type"] == "missing":
            sentences.append(
                f"'{key}' is missing; expected {known[key].allowed() if key in known else 'a value'}"
            )
        else:
            allowed = known[key].allowed() if key in known else issue["msg"]
            sentences.append(f"'{key}' is {issue['input']!r}; allowed: {allowed}")
    return "; ".join(dict.fromkeys(sentences))


def _assign(mapping: dict[str, Any], key: str, value: Any, source: str) -> None:
    *path, last = key.split(".")
    level = mapping
    for part in path:
        if not isinstance(level.get(part), dict):
            raise InputError(f"{source}: unknown key '{part}'; allowed here: {', '.join(sorted(level))}")
        level = level[part]
    if last not in level:
        raise InputError(f"{source}: unknown key '{key}'; allowed here: {', '.join(sorted(level))}")
    level[last] = value


def _describe(cls: type, prefix: str) -> Iterator[SettingDescription]:
    for field in dataclasses.fields(cls):
        hint = _hints(cls)[field.name]
        if isinstance(hint, type) and dataclasses.is_dataclass(hint):
            yield from _describe(hint, f"{prefix}{field.name}.")
            continue
        default = field.default
        if default is dataclasses.MISSING and field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        yield SettingDescription(
            key=f"{prefix}{field.name}",
            type=_base_type(hint),
            default=default,
            unit=field.metadata.get("unit", ""),
            description=field.metadata.get("description", ""),
            limits=field.metadata.get("limits", {}),
            choices=field.metadata.get("choices", ()),
        )


def _base_type(hint: Any) -> type:
    if _is_optional(hint):
        hint = _without_none(hint)
    origin = typing.get_origin(hint)
    if origin is not None:
        return origin if isinstance(origin, type) else str
    return hint if isinstance(hint, type) else str
