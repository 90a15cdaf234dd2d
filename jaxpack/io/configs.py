"""Frozen dataclasses as JSON and back, checked."""

import math
import types
import typing
from dataclasses import MISSING, asdict, fields, is_dataclass
from typing import Any, TypeVar

from jaxpack.errors import UserError
from jaxpack.learning.bin_network import SEES, Sees
from jaxpack.learning.networks import NETWORKS, Network
from jaxpack.learning.recipe import TrainConfig
from jaxpack.model.instances import Distribution, Source
from jaxpack.model.numbers import fault, show
from jaxpack.model.orders import Goods, Orders

T = TypeVar("T")


def config_to_dict(config: Any) -> dict[str, Any]:
    """A (nested) dataclass as plain data that `json` can write; of orders not what is in them."""

    def plain(options: list[tuple[str, Any]]) -> dict[str, Any]:
        return {name: value for name, value in options if not isinstance(value, Goods)}

    return asdict(config, dict_factory=plain)


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
    if cls is TrainConfig:
        data = _of_today(data)
    hints, names = typing.get_type_hints(cls), _options(cls)
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
        hint, nothing = typing.get_args(hint)
        assert nothing is types.NoneType
        if value is None:
            return None
    if hint is Network:
        return _network(value, where)
    if hint is Source:
        return _source(value, where)
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


def _network(value: Any, where: str) -> Network:
    """The network with this name. Version 0.1 wrote none: then the one that has the options."""
    options = dict(value) if isinstance(value, dict) else value
    kinds = list(NETWORKS.values())
    if isinstance(value, dict) and "name" in value:
        name = options.pop("name")
        kinds = [kind for kind in kinds if kind.name == name]
        if not kinds:
            known = " or ".join(NETWORKS)
            raise fault(where, f"there is no network {show(name)}: choose {known}")
    elif isinstance(value, dict):
        kinds = [kind for kind in kinds if value.keys() <= _options(kind)] or kinds
    return config_from_dict(kinds[0], options, where)


def _source(value: Any, where: str) -> Source:
    """Random items, or the orders of a file, which is not read."""
    if isinstance(value, dict) and "files" in value:
        return config_from_dict(Orders, value, where)
    return config_from_dict(Distribution, value, where)


def _options(cls: Any) -> set[str]:
    return {field.name for field in fields(cls) if field.init}


def _of_today(options: dict[str, Any]) -> dict[str, Any]:
    """A recipe's options, those of version 0.1 in the words of today."""
    options = dict(options)
    learner, credit = options.get("learner"), options.get("credit")
    if credit == "order":
        del options["credit"]
    if (learner, credit) == ("leave-one-out", "bin"):
        del options["credit"]
        options["learner"] = "leave-one-out-by-bin"
    policy = options.get("policy")
    if isinstance(policy, dict) and policy.keys() & set(Sees._fields):
        flags = [policy.get(name, name != "stock") for name in Sees._fields]
        kept = {name: value for name, value in policy.items() if name not in Sees._fields}
        for name, sees in SEES.items():
            if list(sees) == flags:
                options["policy"] = kept | {"sees": name}
    return options
