"""Errors and warnings that the toolkit raises on purpose, by type."""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Iterable
from inspect import Parameter, Signature, signature
from numbers import Integral
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class InputError(ValueError):
    """Input that cannot be used. The message names what is wrong, what was expected and what came.

    Attributes
    ----------
    findings : tuple of Finding
        What looked wrong with the data of a calibration that gave no result; it may well be the reason.
    """

    findings: tuple[Any, ...] = ()


class DegenerateMotionError(InputError):
    """The motions do not determine X.

    Attributes
    ----------
    directions : (k, 6) array
        Unit vectors ``a`` for which the variance of ``a^T xi`` is infinite, ``xi = (theta, tau)`` the error of X
        (left rotation, additive translation, in the frame of ``A``: the gripper for eye-in-hand).
    partial : object or None
        What could be computed all the same, if anything.
    """

    def __init__(self, message: str, directions: NDArray[np.float64], partial: Any = None) -> None:
        super().__init__(message)
        self.directions = directions
        self.partial = partial

    def __reduce__(self) -> tuple[Any, ...]:  # an exception is pickled by its message alone
        return type(self), (str(self), self.directions, self.partial)


class NotConvergedError(RuntimeError):
    """An iteration did not converge; ``partial`` holds what it reached, with a flag, ``findings`` as `InputError`."""

    findings: tuple[Any, ...] = ()

    def __init__(self, message: str, partial: Any = None) -> None:
        super().__init__(message)
        self.partial = partial


class MissingExtraError(InputError):
    """The work needs an optional extra of the package that is not installed; the message names it."""


class SingularNoiseError(InputError):
    """The noise model leaves a part of the residuals exact, so that nothing can be weighted by its inverse."""


def require_known(function: str, given: Iterable[str], known: type) -> None:
    """Raise `TypeError`, as Python does, for names of arguments that are not among the fields of ``known``."""
    names = {name for one in known.__mro__ for name in getattr(one, "__annotations__", ())}
    if unknown := set(given) - names:
        raise TypeError(f"{function}() got an unexpected keyword argument {min(unknown)!r}")


def keywords_of(function: Callable[..., Any], known: type) -> Signature:
    """Return the signature of a function whose further keywords are the fields of ``known``."""
    own = {name: one for name, one in signature(function).parameters.items() if one.kind is not Parameter.VAR_KEYWORD}
    fields = {name: one.replace(kind=Parameter.KEYWORD_ONLY) for name, one in signature(known).parameters.items()}
    return Signature([*(own | fields | own).values()])


def require_type(name: str, value: Any, kinds: type | tuple[type, ...], wanted: str) -> None:
    """Raise `InputError` unless ``value`` is of one of ``kinds``, which are ``wanted`` in words."""
    if not isinstance(value, kinds):
        raise InputError(f"Expected `{name}` to be {wanted}, got {type(value).__name__}.")


def require_integer(name: str, value: Any, least: int) -> None:
    """Raise `InputError` unless ``value`` is an integer, of Python or NumPy, of at least ``least``."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise InputError(f"Expected `{name}` to be an integer of at least {least}, got {value!r}.")


def among(value: Any, names: Container[str]) -> bool:
    """Return whether ``value`` is one of ``names``; anything but text is not."""
    return isinstance(value, str) and value in names


def require_one_of(name: str, value: Any, names: Collection[str], option: str = "") -> None:
    """Raise `InputError` unless ``value`` is one of ``names``; ``option`` is its name on the command line."""
    if not among(value, names):
        shown = f"`{name}` ({option})" if option else f"`{name}`"
        raise InputError(f"Expected {shown} to be one of {', '.join(names)}, got {value!r}.")


class InputWarning(UserWarning):
    """Input that can be used but looks wrong; the message says why and what to try.

    ``code``: of the finding that it states, if it is of one.
    """

    code: str = ""
