"""Records: results that are converted to the plain values of a file, and back, by the types of their fields.

A `Record` is a frozen dataclass. ``to_dict`` writes its fields as numbers, lists and text, None for what is infinite.
``from_dict`` reads each by its type, so that a damaged file is refused where it is read and not where a part is used.
Types of arrays hold their shape: numbers, or letters for sizes that all arrays of the record share:

    n: int
    share: Annotated[Array, "n"]  # as many as `n` says
    shift: Annotated[Array, "n", 6, INFINITE]  # None in the file stands for an infinite number

A part with its own ``from_dict``, such as `Finding`, is read by that.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from functools import cache
from operator import attrgetter
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..read_only import ReadOnlyArrays
from .one_line import refused
from .tree_values import is_list, is_map, is_plain_number, items_of

T = TypeVar("T")

# Numbers that are computed from others again may differ from those in the file by this, relative to the largest of
# their row: files come from other machines.
FILE_ROUNDING = 1e-5
_LARGEST = int(np.finfo(float).max)


def unequal(again: Any, data: Any, path: str) -> str | None:
    """Return the path where ``data``, as read, differs from what is written again; None if nowhere.

    More names in ``data`` do not matter.
    """
    kind = type(again)
    if is_plain_number(again) and is_plain_number(data):
        return None if abs(again - data) <= FILE_ROUNDING * abs(again) else path
    if kind is not type(data) or (kind is list and len(again) != len(data)):
        return path
    if kind is dict:
        parts = ((part, data.get(name, MISSING), f"{path}.{name}") for name, part in again.items())
    elif kind is list:
        if again and all(map(is_plain_number, again)) and all(map(is_plain_number, data)):
            alike = again == data or np.allclose(again, data, rtol=0.0, atol=FILE_ROUNDING * float(np.abs(again).max()))
            return None if alike else path
        parts = ((part, other, f"{path}[{k}]") for k, (part, other) in enumerate(zip(again, data, strict=True)))
    else:
        return None if again == data else path
    return next((found for part in parts if (found := unequal(*part)) is not None), None)


def array_of(data: Any, shape: tuple[int, ...], path: str, infinite: bool = False) -> NDArray[np.float64]:
    """Numbers of that shape from lists of a file; raises `InputError` on anything else.

    ``infinite``: None stands for an infinite number, which JSON has not.
    """
    try:
        array = np.array(data, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"Expected {path} to be numbers of shape {shape}, got {data!r:.40}.") from error
    if array.shape != shape:
        raise InputError(f"Expected {path} to be numbers of shape {shape}, got shape {array.shape}.")
    if infinite:
        array[np.isnan(array)] = np.inf
    elif not np.isfinite(array).all():
        raise InputError(f"Expected {path} to be finite numbers of shape {shape}.")
    return array


def wrong_number(data: Any, path: str) -> str | None:
    """Return what is wrong with a number of plain values, with its path, in words; None if nothing is.

    NaN, infinity and an integer beyond any float are not finite; true and false in a list are no numbers.
    """
    where = _wrong_number(data, True)
    return None if where is None else path + where


def _wrong_number(data: Any, named: bool) -> str | None:
    """Return the end of the path and the words: files hold many numbers, and few of them are wrong."""
    kind = type(data)
    if kind in (dict, list, tuple):
        for name, part in data.items() if kind is dict else enumerate(data):
            if type(part) is float and math.isfinite(part):
                continue
            if (found := _wrong_number(part, kind is dict)) is not None:
                return f".{name}{found}"
    elif kind is bool and not named:
        return f" is {str(data).lower()}, expected a number"
    elif (kind is int and abs(data) > _LARGEST) or (kind is float and not math.isfinite(data)):
        return " is not finite"
    return None


INFINITE, NUMBER = "infinite", "number"  # NUMBER: an array without axes
_PLAIN = {float: "a number", int: "a whole number", str: "text", bool: "true or false"}


def damaged(what: str) -> refused:
    """Say in one line of `InputError` what is wrong with a file whose parts are missing or do not belong together."""
    wrong = (TypeError, ValueError, AttributeError, LookupError, ArithmeticError)
    return refused(
        f"{what} is damaged: ",
        ((KeyError, lambda error: f"{error} is missing"), (wrong, lambda error: str(error).rstrip("."))),
    )


class Record(ReadOnlyArrays):
    """Base of frozen dataclasses that files hold."""

    # Attributes in the file, in their order, as "key" or "key=attribute"; empty: the fields.
    _in_file: ClassVar[str] = ""
    # Of these, those that are left out where they are None, empty or false.
    _if_any: ClassVar[str] = ""
    # What messages call it; empty: the name of the class, or of the field that it stands in.
    _where: ClassVar[str] = ""

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, lists and text, in rad and m; None stands for an infinite number."""
        names = self._in_file or " ".join(field.name for field in fields(cast(Any, self)))
        found, rare = attributes(self, names), self._if_any.split()
        return {key: value for key, value in found.items() if key not in rare or value}

    @classmethod
    def from_dict(cls, data: Any) -> Self:
        """Read what `to_dict` wrote; raises `InputError` on anything else."""
        return cls(**parts_of(cls, data, cls._where or cls.__name__))._possible()

    def _possible(self) -> Self:
        """Return itself; raise `InputError` for numbers that cannot be. Of what was read."""
        return self


def attributes(value: Any, names: str) -> dict[str, Any]:
    """Return attributes by name as plain values: "key", or "key=attribute" (also "key=part.attribute")."""
    parts = (name.partition("=") for name in names.split())
    return {key: plain(attrgetter(attribute or key)(value)) for key, _, attribute in parts}


def plain(value: Any) -> Any:
    """Return plain values: dictionaries of records and named tuples, lists of arrays; None for what is not finite."""
    kind = type(value)
    if kind in (float, np.float64):
        return float(value) if math.isfinite(value) else None
    if value is None or kind in (str, bool, int):
        return value
    if isinstance(value, Enum):
        return value.value
    if hasattr(value, "dtype"):
        whole = value.dtype.kind != "f" or bool(np.isfinite(value).all())
        return value.tolist() if whole else plain(value.tolist())
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if hasattr(value, "_asdict"):
        value = value._asdict()
    elif is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if hasattr(value, "items"):
        return {name: plain(part) for name, part in value.items()}
    return [plain(part) for part in value]


def parts_of(
    kind: Any, data: Any, path: str, sizes: Mapping[str, int] | None = None, /, **given: Any
) -> dict[str, Any]:
    """Return the fields of a record, read by their types; ``given`` have been read.

    A `Record` may hold more names, of what it writes beside its fields or of another version; others may not.

    ``sizes``: those of arrays by letter, of the record that this one is a part of.
    """
    names = [field.name for field in fields(kind)] if is_dataclass(kind) else kind._fields
    if is_list(data) and not is_dataclass(kind):
        data = dict(zip(names, data, strict=False))
    if not is_map(data):
        raise InputError(f"Expected {path} with {', '.join(names)}, got {data!r:.40}.")
    if not issubclass(kind, Record) and (more := [name for name in data if name not in names]):
        raise InputError(f"Expected {path} with {', '.join(names)}, got also {more[0]!r:.40}.")
    known, hints, found = dict(sizes or {}), _hints(kind), dict(given)
    for name in (name for name in names if name not in given):
        if name in data:
            found[name] = read(hints[name], data[name], f"{path}.{name}", known)
            if hints[name] is int:
                known.setdefault(name, found[name])
        elif name not in _defaults(kind):
            raise InputError(f"Expected {path} to have {name!r}, which is missing.")
    return found


def read(hint: Any, data: Any, path: str, sizes: dict[str, int] | None = None) -> Any:
    """Return a value of a type from plain values; raises `InputError` that names the part by its path."""
    kind, args = get_origin(hint) or hint, get_args(hint)
    sizes = {} if sizes is None else sizes
    if kind is Annotated:
        if get_origin(args[0]) is np.ndarray:
            return _array(data, hint.__metadata__, path, sizes, args[0])
        return math.inf if data is None else read(args[0], data, path, sizes)
    if kind in (Union, UnionType):
        if data is None and NoneType in args:
            return None
        kinds = [arg for arg in args if arg is not NoneType]
        return data if len(kinds) > 1 else read(kinds[0], data, path, sizes)  # a value of JSON
    if kind in _PLAIN:
        if type(data) is not kind and not (kind is float and type(data) is int):
            raise InputError(f"Expected {path} to be {_PLAIN[kind]}, got {data!r:.40}.")
        return data
    if kind is Literal:
        if data not in args:
            raise InputError(f"Expected {path} to be one of {', '.join(map(str, args))}, got {data!r:.40}.")
        return data
    if kind in (tuple, dict):
        return _many(kind, args, data, path, sizes)
    if kind in (Any, Hashable, list):
        return data
    if hasattr(kind, "from_dict") and getattr(kind.from_dict, "__func__", None) is not Record.from_dict.__func__:  # type: ignore[attr-defined]
        return kind.from_dict(data)
    found = kind(**parts_of(kind, data, getattr(kind, "_where", "") or path, sizes))
    return found._possible() if hasattr(found, "_possible") else found


def _many(kind: type[Any], args: tuple[Any, ...], data: Any, path: str, sizes: dict[str, int]) -> Any:
    """Return a tuple from a list, or a dictionary of names."""
    if kind is dict:
        if not is_map(data):
            raise InputError(f"Expected {path} to be a dictionary, got {data!r:.40}.")
        return {name: read(args[1], value, f"{path}.{name}", sizes) for name, value in data.items()}
    if not is_list(data):
        raise InputError(f"Expected {path} to be a list, got {data!r:.40}.")
    kinds = args[:1] * len(data) if args[1:] == (Ellipsis,) else args
    if len(kinds) != len(data):
        raise InputError(f"Expected {path} to have {len(kinds)} parts, got {len(data)}.")
    return tuple(read(of, part, f"{path}[{k}]", sizes) for k, (of, part) in enumerate(zip(kinds, data, strict=True)))


def _array(data: Any, shape: tuple[Any, ...], path: str, sizes: dict[str, int], hint: Any) -> Any:
    """Return an array of that shape; letters get their size where they have none yet."""
    at, wanted = data, []
    for size in shape:
        if size not in (INFINITE, NUMBER):
            wanted.append(sizes.setdefault(size, len(items_of(at))) if type(size) is str else size)
            at = next(iter(items_of(at)), [])
    if 0 in wanted and data == []:  # lists do not say how many columns no row has
        return np.zeros(wanted)
    found = array_of(data, tuple(wanted), path, INFINITE in shape)
    if get_args(hint)[1] != np.dtype[np.intp]:
        return found
    if (found != np.floor(found)).any():
        raise InputError(f"Expected {path} to be whole numbers.")
    return found.astype(np.intp)


@cache
def _hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


@cache
def _defaults(kind: Any) -> frozenset[str]:
    if not is_dataclass(kind):
        return frozenset(kind._field_defaults)
    return frozenset(f.name for f in fields(kind) if f.default is not MISSING or f.default_factory is not MISSING)
