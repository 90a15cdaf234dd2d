"""Frozen dataclasses as JSON and back, checked."""

import math
import types
import typing
from dataclasses import MISSING, asdict, fields, is_dataclass
from typing import Any, TypeVar

from jaxpack.errors import UserError
from jaxpack.model.numbers import fault, show

T = TypeVar("T")


def config_to_dict(config: Any) -> dict[str, Any]:
    """A (nested) dataclass as plain data that `json` can write."""
    return asdict(config)


def config_from_dict(cls: type[T], data: Any, where: str = "config") -> T:
    """The dataclass `cls` from what `config_to_dict` made, nested ones and tuples included.

    An option that is not there has its default: what an older version wrote stays readable.

    Args:
        where: what the message begins with, such as the file's name.

    Raises:
        UserError: naming the first key that is unknown, of the wrong kind, or missing and needed.
    """
    assert is_dataclass(cls)
    if not isinstance(data, dict):
        raise fault(where, f"expected a table of options, found {show(data)}")
    hints = typing.get_type_hints(cls)
    names = {field.name for field in fields(cls)}
    needed = {f.name for f in fields(cls) if f.default is MISSING and f.default_factory is MISSING}
    if wrong := sorted((needed - data.keys()) | (data.keys() - names)):
        kind = "missing" if wrong[0] in names else "unknown"
        raise fault(where, f"option {show(wrong[0])} is {kind}; is it of another version?")
    values = {name: _value(hints[name], data[name], f"{where}.{name}") for name in data}
    try:
        return cls(**values)
    except UserError as error:  # the dataclass's own rules, which do not know the file
        raise fault(where, str(error)[:300]) from error


def _value(hint: Any, value: Any, where: str) -> Any:
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        if value is None and types.NoneType in typing.get_args(hint):
            return None
        hint = _arm(hint, value)
    if is_dataclass(hint):
        return config_from_dict(typing.cast(type, hint), value, where)
    if typing.get_origin(hint) is tuple:
        return _tuple(typing.get_args(hint), value, where)
    if hint is float and type(value) is int and abs(value) < 2**53:
        value = float(value)
    if type(value) is not hint or (hint is float and not math.isfinite(value)):
        raise fault(where, f"{show(value)} is not of type {hint.__name__}")
    return value


def _tuple(kinds: tuple[Any, ...], value: Any, where: str) -> tuple:
    """`kinds`: of each member, or of all and an ellipsis."""
    if not isinstance(value, list | tuple):
        raise fault(where, f"{show(value)} is not a list")
    if kinds[-1] is Ellipsis:
        kinds = kinds[:1] * len(value)
    if len(value) != len(kinds):
        raise fault(where, f"{show(value)} has {len(value)} members, not {len(kinds)}")
    members = enumerate(zip(kinds, value, strict=True))
    return tuple(_value(kind, member, f"{where}[{i}]") for i, (kind, member) in members)


def _arm(union: Any, value: Any) -> Any:
    """The member of a union that a value is meant for: of dataclasses the one with its options."""
    arms = [arm for arm in typing.get_args(union) if arm is not type(None)]
    for arm in arms:
        names = {field.name for field in fields(arm)} if is_dataclass(arm) else set()
        if isinstance(value, dict) and value.keys() <= names:
            return arm
    return arms[0]
