"""Errors of a rig as they were declared: of all arms, cameras and targets, or of one by its name.

A `SharedError` holds for every owner of such an error, one made by `SharedError.of` for the owner of that name; a size
holds for all errors of its name, ``left:camera rotation`` for those of one. What is declared replaces what is assumed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ...core.files.json_values import JsonObject
from ...errors import InputError
from ...model.errors.key import ErrorKey, Owner
from ...model.errors.keys import ROBOT_ACCURACY, TARGET_SCALE
from ...model.errors.sizes import SIZES, Size, prior_from_dict, prior_to_dict
from ...model.errors.term import ErrorTerm
from ...model.shared_errors.assumed import OF_VIEWS
from ...model.shared_errors.shared_error import OF_ANY_POSES, SharedError
from .request import Request

# Of a rig: what its errors are declared by.
Errors = Sequence[SharedError]


def declared_of(errors: Errors, key: ErrorKey) -> SharedError | None:
    """Return what was declared of an error of one owner: for it, or for all of them."""
    by_key = {error.key: error for error in errors}
    return by_key.get(key) or by_key.get(key.of(""))


def with_declared(parts: Sequence[ErrorTerm], request: Request) -> tuple[ErrorTerm, ...]:
    """Return the components with the sizes that were declared, without those declared exact.

    Raises `InputError` for a size of an error that the rig does not have.
    """
    errors, given = request.shared or (), dict(request.sizes or {})
    found, used = [], set[str]()
    for part in parts:
        plain, size = part.key.of(""), part.size
        if part.key.owner == Owner.TARGETS and declared_of(errors, TARGET_SCALE) is not None:
            continue  # the size is declared of each target
        if (error := declared_of(errors, part.key)) is not None:
            if error.is_exact:
                continue
            if error.key.of("") != ROBOT_ACCURACY:  # whose component is made of what was declared
                size = Size(float(error.sd[0]), error.factor, size.unit, "declared")
        if (sheet := (request.prior or {}).get(plain)) is not None:
            if sheet.median == 0:
                continue
            size = sheet
        for name in (str(plain), f"{part.key.name}:{plain}"):
            if name in given:
                one: Any = given[name]
                size, used = replace(one, unit=size.unit), used | {name}
        found.append(part if size is part.size else replace(part, size=size))
    if unknown := [name for name in given if name not in used]:
        names = ", ".join(dict.fromkeys(str(part.key.of("")) for part in parts))
        raise InputError(
            f"Expected sizes of errors of this rig, such as 'robot accuracy' or 'left:camera rotation', got "
            f"{unknown[0]!r}. It has {names}."
        )
    return tuple(found)


def further_errors(request: Request, parts: Sequence[ErrorTerm]) -> list[SharedError]:
    """Return the declared errors that none of the components is; raises `InputError` for columns of the user's own."""
    have = {part.key.of("") for part in parts}
    found = []
    for error in request.shared or ():
        if error.is_exact or error.key.of("") in have:
            continue
        if error.key.of("") not in OF_ANY_POSES:
            raise InputError(
                f"Expected errors of arms, cameras and targets in `shared`, got {error.name!r}. Columns of views: "
                "View(covariance=..., intrinsics=...)."
            )
        found.append(error)
    return found


def request_to_dict(request: Request) -> JsonObject:
    """Return the options of a rig as plain values of a file."""
    sizes: Mapping[str, Any] = request.sizes or {}
    errors = [error.to_dict() for error in request.shared or () if not (error.is_exact and error.key in OF_VIEWS)]
    return {
        "method": request.taken_method,
        "robust": request.robust is not False,
        "seed": int(request.seed),
        "covariance": request.covariance,
        **({} if not errors else {"errors": errors}),
        **({} if not sizes else {"sizes": {name: [size.median, size.factor] for name, size in sizes.items()}}),
        **({} if request.prior is None else {"prior": prior_to_dict(request.prior)}),
    }


def request_from_dict(data: Mapping[str, Any]) -> Request:
    """Read the options that `request_to_dict` wrote."""
    sizes = {
        name: Size(float(median), float(factor), unit_of(name)) for name, (median, factor) in data["sizes"].items()
    } if data.get("sizes") else None  # fmt: skip
    prior = None if data.get("prior") is None else prior_from_dict(data["prior"])
    errors = [SharedError.from_dict(one) for one in data.get("errors", ())] or None
    return Request(
        method=data["method"], robust=data["robust"], seed=data["seed"], covariance=data.get("covariance", "model"),
        shared=errors, sizes=sizes, prior=prior,
    )  # fmt: skip


def unit_of(name: str) -> str:
    """Return the unit of the size of an error by its name, also of one owner."""
    plain = name.rpartition(":")[2]
    return next((size.unit for key, size in SIZES.items() if str(key) == plain), "")
