"""Functions that take the fields of a dataclass as keywords: shown in their signature, and checked once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from inspect import Parameter, Signature, signature
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])
T = TypeVar("T")


def takes_fields_of(known: type) -> Callable[[Function], Function]:
    """Decorate a function whose further keywords are the fields of ``known``: its signature names them."""

    def decorate(function: Function) -> Function:
        own = [one for one in signature(function).parameters.values() if one.kind is not Parameter.VAR_KEYWORD]
        more = (one.replace(kind=Parameter.KEYWORD_ONLY) for one in signature(known).parameters.values())
        function.__signature__ = Signature([*own, *more])  # type: ignore[attr-defined]
        return function

    return decorate


def fields_from(known: type[T], function: str, given: Mapping[str, Any]) -> T:
    """Return ``known`` with its fields as given; raises the `TypeError` of the function for other names."""
    if unknown := set(given) - {field.name for field in fields(known)}:  # type: ignore[arg-type]
        raise TypeError(f"{function}() got an unexpected keyword argument {min(unknown)!r}")
    return known(**given)
