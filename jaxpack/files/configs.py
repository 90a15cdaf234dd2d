"""Frozen dataclasses as JSON and back, checked."""

import types
import typing
from dataclasses import MISSING, asdict, fields, is_dataclass
from typing import Any, TypeVar

from jaxpack.errors import UserError

T = TypeVar("T")


def config_to_dict(config: Any) -> dict[str, Any]:
    """A (nested) dataclass as plain data that `json` can write."""
    return asdict(config)


def config_from_dict(cls: type[T], data: Any, where: str = "config") -> T:
    """The dataclass `cls` from what `config_to_dict` made, nested ones and tuples included.

    An option that is not there has its default: what an older version wrote stays readable.

    Raises:
        UserError: naming the first key that is unknown, of the wrong kind, or missing and needed.
    """
    assert is_dataclass(cls)
    if not isinstance(data, dict):
        raise UserError(f"{where}: expected a table of options, found {data!r}")
    hints = typing.get_type_hints(cls)
    names = {field.name for field in fields(cls)}
    needed = {f.name for f in fields(cls) if f.default is MISSING and f.default_factory is MISSING}
    if wrong := sorted((needed - data.keys()) | (data.keys() - names)):
        kind = "missing" if wrong[0] in names else "unknown"
        raise UserError(f"{where}: option '{wrong[0]}' is {kind}; is it of another version?")
    return cls(**{name: _value(hints[name], data[name], f"{where}.{name}") for name in data})


def _value(hint: Any, value: Any, where: str) -> Any:
    if is_dataclass(hint):
        return config_from_dict(typing.cast(type, hint), value, where)
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        if value is None:
            return None
        hint = _arm(hint, value)
        if is_dataclass(hint):
            return config_from_dict(typing.cast(type, hint), value, where)
    if typing.get_origin(hint) is tuple and isinstance(value, list | tuple):
        kind = typing.get_args(hint)[0]
        return tuple(_value(kind, item, f"{where}[{i}]") for i, item in enumerate(value))
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if isinstance(hint, type) and (
        not isinstance(value, hint) or isinstance(value, bool) != (hint is bool)
    ):
        raise UserError(f"{where}: {value!r} is not of type {hint.__name__}")
    return value


def _arm(union: Any, value: Any) -> Any:
    """The member of a union that a value is meant for: of dataclasses the one with its options."""
    arms = [arm for arm in typing.get_args(union) if arm is not type(None)]
    for arm in arms:
        names = {field.name for field in fields(arm)} if is_dataclass(arm) else set()
        if isinstance(value, dict) and value.keys() <= names:
            return arm
    return arms[0]
