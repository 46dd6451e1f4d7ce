r"""Errors that all poses share, as unknowns with a prior (T10).

Noise differs from pose to pose. A focal length that is 0.1 % too long moves every camera pose, always along the optical
axis; it does not average out, and residuals show only what X and W cannot absorb of it. With e the k numbers of such an
error, the error ``xi = (theta, tau)`` of pose i of its side is to first order

    xi_i = eta_i + F_i e,      e ~ N(0, diag(sd^2)),      F_i (6, k)

eta_i the pose's own noise. An error is that of the value which was *used*: ``e = used / true - 1`` for lengths and
scales, ``used - true`` for others.

| error | side | F_i | unit of e |
|---|---|---|---|
| focal length | camera | of poses fitted to a target (`view`); near ``(0; 0, 0, t_z)`` | relative |
| principal point | camera | likewise; a rotation about the camera to a shift | rad: pixels over focal length |
| target scale | camera | ``(0; t)`` | relative |
| robot scale | robot | ``(0; t)`` | relative |
| clock offset | robot | ``rate_i``, velocity between its neighbours in time | s |

t is the translation of ``camera_T_target`` or ``base_T_gripper`` (m). The columns are taken at the poses as measured,
and by `calibrate` once more as the fit corrects them.

A standard deviation may itself be known within a factor only (``factor``, one sigma of its logarithm): its size is
then estimated jointly, and integrated over (`fit.graph.integration`). The tail of such a size covers mistakes: a square
agrees with its drawing to 0.03 %, or it was measured wrongly. The errors of an arm's kinematics are one `SharedError`
for each group of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.files.json_values import JsonObject
from ...core.geometry.checks import as_numbers
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array
from ...core.presentation.numbers import digits
from ...core.presentation.units import parse_angle, parse_length, parse_ratio, parse_time
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError
from ..errors.cholesky import symmetric_factor
from ..errors.columns import MANY_POSES, Columns, Factor, Products, rows_of_factor, some_rows
from ..errors.key import ErrorKey, Kind, Owner
from ..errors.keys import (
    CAMERA_SCALE,
    CLOCK_OFFSET,
    FOCAL_LENGTH,
    INTRINSICS,
    LENS,
    OUTLINE,
    PRINCIPAL_POINT,
    ROBOT_ACCURACY,
    ROBOT_SCALE,
    TARGET_SCALE,
    VIEW,
)
from ..errors.sizes import SIZES, RobotAccuracy, Size, stated_accuracy
from ..errors.term import ErrorTerm
from ..poses.pose_pairs import PosePairs
from ..poses.timing import SIDES
from .view import intrinsics_columns, median_distance, target_centre

# Errors whose effect follows from poses, whatever they are.
OF_ANY_POSES = frozenset(
    {
        FOCAL_LENGTH,
        PRINCIPAL_POINT,
        TARGET_SCALE,
        CAMERA_SCALE,
        ROBOT_SCALE,
        CLOCK_OFFSET,
        VIEW,
        LENS,
        OUTLINE,
        ROBOT_ACCURACY,
    }
)
# Largest difference of poses, over the reach of the arm, with the same columns of its errors.
SAME_POSE_SHARE = 0.02
# Those whose columns are made of the translations of the poses, and hold their noise.
OF_LENGTHS = (FOCAL_LENGTH, PRINCIPAL_POINT, TARGET_SCALE, CAMERA_SCALE, ROBOT_SCALE)

# Relative error of the size of a target beyond which it is reported as another size.
WRONG_SIZE = 3e-3
# Standard deviations of errors that are declared without one: relative for lengths and scales, rad for the principal
# point, s for the clock offset.
DEFAULT_SD = {
    FOCAL_LENGTH: SIZES[FOCAL_LENGTH].median,
    PRINCIPAL_POINT: SIZES[PRINCIPAL_POINT].median,
    TARGET_SCALE: 2e-4,
    ROBOT_SCALE: 1e-4,
    CLOCK_OFFSET: 1e-3,
}

# Relative standard deviation of a scale of which nothing is known. The camera poses are scaled until their error is 0,
# where the prior does not pull; a larger one would leave rounding as what is open.
FLAT_SCALE_SD = 0.3
# A declared size of the target that is as uncertain as this says nothing of it.
WIDE_SCALE_SD = 0.1

# In place of a standard deviation: 0, which switches an error off.
EXACT = ("none", "exact")


@dataclass(frozen=True, eq=False)
class SharedError(ReadOnlyArrays):
    """One error of all poses of a side, with the standard deviations ``sd`` (k) that are assumed for its k numbers.

    Made by `focal_length`, `principal_point`, `target_scale`, `robot_scale`, `clock_offset` or `columns`.
    """

    key: ErrorKey
    unit: str  # "" (relative), "rad", "s", or that of the user's columns
    side: str  # "robot" or "camera"
    sd: Array  # (k,)
    keys: tuple[ErrorKey, ...]  # of each of the k numbers
    effect: Callable[[PosePairs], Factor]  # (n, 6, k) per unit
    factor: float = 1.0  # within which ``sd`` is known; 1: as it is
    default: bool = False  # assumed, not declared
    focal_length_px: float | None = None  # of a principal point in pixels
    stated: str = ""  # in words, where the numbers are in units of what was declared
    bind: Callable[[PosePairs], dict[str, Any]] | None = None  # what changes once it belongs to poses; None: bound
    left: Array | None = None  # (n, 6, 6) per unit^2 that its numbers leave of the poses that it is bound to
    unseen: Callable[[PosePairs, bool], Array] | None = None  # the same of other poses, with measured noise or without
    accuracy: RobotAccuracy | None = None  # of a robot, once it is bound
    declared: tuple[float, float, float | None] | None = (
        None  # accuracy of a robot (m, rad) and its reach (m), as given
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "sd", np.atleast_1d(as_numbers(self.sd, f"sd of the shared error {self.name!r}")))
        _require_sd(self.sd, self.name)
        if self.side not in SIDES:
            raise InputError(
                f"Expected `side` of the shared error {self.name!r} to be robot or camera, got {self.side!r}."
            )
        super().__post_init__()

    @property
    def name(self) -> str:
        """The error in words."""
        return str(self.key)

    @property
    def is_exact(self) -> bool:
        """True if it is switched off: standard deviations of 0."""
        return not self.sd.any()

    @property
    def size(self) -> Size:
        """The standard deviation of its first number, with the others in proportion; 0 where it is switched off."""
        plain = self.key.of("")
        unit = SIZES[plain].unit if plain in SIZES else self.unit
        return Size(0.0, unit=unit) if self.is_exact else Size(float(self.sd[self.sd > 0][0]), self.factor, unit)

    def term(self, poses: PosePairs) -> ErrorTerm:
        """Return the bound error at these poses, with the columns of its numbers per unit of its size."""
        size, block = self.size, None
        if self.left is not None and len(self.left) == poses.n:
            block = symmetric_factor(self.left)
        columns, keys = self._columns_at(poses, self.sd / size.median), tuple(compress(self.keys, self.sd > 0))
        return ErrorTerm(self.key, self.side, size, columns, block, keys)

    def columns_of_sd(self, poses: PosePairs) -> Array | Columns:
        """Return the columns at these poses of one standard deviation of each number, without exact ones."""
        return self._columns_at(poses, self.sd)

    def _columns_at(self, poses: PosePairs, scale: Array) -> Array | Columns:
        found = Columns.of([self.factor_at(poses)], scale).some(np.flatnonzero(self.sd > 0))
        return found.rows(slice(None)) if found.n <= MANY_POSES else found

    def switched_off(self) -> SharedError:
        """Return the error with standard deviations of 0."""
        none = (0.0, 0.0, None) if self.declared is not None else None
        return replace(self, sd=np.zeros_like(self.sd), factor=1.0, bind=None, declared=none)

    def of(self, name: str) -> SharedError:
        """Return the error of one arm, camera or target of a rig, in place of that of all of them."""
        return replace(self, key=self.key.of(name)) if name else self

    def sized(self, size: Size) -> SharedError:
        """Return the bound error with a size that was declared: that of its first number, the others in proportion."""
        stated = f"{digits(1e3 * size.median, 2)} mm" if self.stated else ""
        times = size.median / float(self.sd[0])
        return replace(self, sd=times * self.sd, factor=size.factor, default=False, stated=stated)

    def of_size(self, size: float) -> SharedError:
        """Return the error with a size that was found and is known from then on."""
        if self.factor == 1 and size == self.size.median:
            return self
        found = replace(self, sd=size / self.size.median * self.sd, factor=1.0)
        if not self.stated:
            return found
        return replace(found, stated=f"{digits(1e3 * float(found.sd[0]), 2)} mm (found; {self.stated} assumed)")

    @property
    def described(self) -> list[str]:
        """Each number with its standard deviation; one line where there are many."""
        if self.stated:
            return [f"{self.name}: {self.stated if self.sd.any() else 'exact'}"]
        if len(self.keys) > 1 and self.keys[0].source != self.keys[0]:
            ends = list(dict.fromkeys(f"{end:.6g}" for end in (self.sd.min(), self.sd.max())))
            return [f"{self.name} ({len(self.keys)}): {' to '.join(ends)}"]
        return [f"{key}: {sd:.6g}" for key, sd in zip(self.keys, self.sd, strict=True)]

    @classmethod
    def focal_length(cls, sd: float | str = DEFAULT_SD[FOCAL_LENGTH]) -> SharedError:
        """Relative standard deviation of the focal length, as a number, ``"0.1%"`` or, as of all of these, "exact"."""
        each = _sd(sd, FOCAL_LENGTH, parse_ratio)
        return cls(FOCAL_LENGTH, "", "camera", each, (FOCAL_LENGTH,), **of_intrinsics(slice(0, 1)))

    @classmethod
    def principal_point(
        cls, sd: float | str = DEFAULT_SD[PRINCIPAL_POINT], *, focal_length_px: float | None = None
    ) -> SharedError:
        """Standard deviation of each coordinate over the focal length (rad), or ``"1px"`` with the focal length."""

        def parse(value: float | str, name: str) -> float:
            if not isinstance(value, str):
                return parse_angle(value, name)
            number, in_pixels = value.strip().removesuffix("px"), value.strip().endswith("px")
            try:
                plain = float(number)
            except ValueError:
                if not in_pixels:
                    return parse_angle(value, name)
                raise InputError(f"Expected {name} to be such as '1px' or 0.001 (rad), got {value!r}.") from None
            if not in_pixels:
                return parse_angle(plain, name)
            if focal_length_px is None:
                raise InputError(
                    f"Expected the focal length in pixels beside {name} of {value!r}; or give it over the focal "
                    "length, such as 0.001 (rad; 1 px at 1000 px)."
                )
            if not 0 < focal_length_px < np.inf:
                raise InputError(f"Expected `focal_length_px` to be above 0 and finite, got {focal_length_px!r}.")
            return plain / focal_length_px

        keys = PRINCIPAL_POINT.number("x"), PRINCIPAL_POINT.number("y")
        each = _sd(sd, PRINCIPAL_POINT, parse)
        return cls(
            PRINCIPAL_POINT, "rad", "camera", np.repeat(each, 2), keys, focal_length_px=focal_length_px,
            **of_intrinsics(slice(1, 3)),
        )  # fmt: skip

    @classmethod
    def target_scale(cls, sd: float | str = DEFAULT_SD[TARGET_SCALE]) -> SharedError:
        """Relative standard deviation of the size of the target (its squares), as a number or ``"0.02%"``."""
        return cls(TARGET_SCALE, "", "camera", _sd(sd, TARGET_SCALE, parse_ratio), (TARGET_SCALE,), _scale("camera"))

    @classmethod
    def camera_scale(cls, sd: float = FLAT_SCALE_SD) -> SharedError:
        """Relative error of the scale of camera poses that have none of their own, with a flat prior."""
        return cls(CAMERA_SCALE, "", "camera", np.array([sd]), (CAMERA_SCALE,), _scale("camera"))

    @classmethod
    def robot_scale(cls, sd: float | str = DEFAULT_SD[ROBOT_SCALE]) -> SharedError:
        """Relative standard deviation of the robot's lengths, as a number or ``"0.01%"``."""
        return cls(ROBOT_SCALE, "", "robot", _sd(sd, ROBOT_SCALE, parse_ratio), (ROBOT_SCALE,), _scale("robot"))

    @classmethod
    def clock_offset(cls, sd: float | str = DEFAULT_SD[CLOCK_OFFSET]) -> SharedError:
        """Standard deviation of the offset between the clocks (s, or ``"1ms"``), for poses with timestamps."""
        return cls(CLOCK_OFFSET, "s", "robot", _sd(sd, CLOCK_OFFSET, parse_time), (CLOCK_OFFSET,), _rate)

    @classmethod
    def columns(cls, name: str, F: ArrayLike, sd: ArrayLike, side: str, *, unit: str = "") -> SharedError:
        """An error of the user's own: ``F`` (n, 6, k) is its effect on ``side`` per unit, ``sd`` one or (k,).

        ``F`` holds (theta, tau) per unit, rad and m, in the parent frame of the poses: base or camera.
        """
        if not isinstance(name, str) or not name.strip():
            raise InputError(f"Expected the `name` of a shared error to be text, got {name!r}.")
        if name in map(str, (*DEFAULT_SD, INTRINSICS, ROBOT_ACCURACY)):
            raise InputError(f"Expected another `name` than {name!r}, which is that of a built-in shared error.")
        if not isinstance(unit, str):
            raise InputError(f"Expected `unit` of the shared error {name!r} to be text, got {unit!r}.")
        given = np.array(as_numbers(F, f"F of the shared error {name!r}"))
        given = given[..., None] if given.ndim == 2 else given
        if given.ndim != 3 or given.shape[1] != 6 or given.shape[2] == 0:
            raise InputError(
                f"Expected the columns `F` of the shared error {name!r} to have shape (n, 6, k), got {np.shape(F)}."
            )
        if not np.isfinite(given).all():
            raise InputError(f"Expected the columns `F` of the shared error {name!r} to be finite, got nan or inf.")
        k = given.shape[2]
        each = np.array(as_numbers(sd, f"sd of the shared error {name!r}"))
        if each.shape not in ((), (k,)):
            raise InputError(f"Expected `sd` of the shared error {name!r} to be one number or {k}, got {each.shape}.")
        each = np.broadcast_to(each, (k,)).copy()
        if side not in SIDES:
            raise InputError(f"Expected `side` of the shared error {name!r} to be robot or camera, got {side!r}.")
        key = ErrorKey(Owner(side), Kind.OWN, name=name)
        keys = (key,) if k == 1 else tuple(key.number(j + 1) for j in range(k))
        return cls(key, unit, side, each, keys, lambda poses: given)

    @classmethod
    def robot_accuracy(
        cls, translation: float | str, rotation: float | str | None = None, *, reach: float | str | None = None
    ) -> SharedError:
        """The accuracy that the robot's data sheet states: errors as a population of arms has them (`population`).

        ``translation`` in m or ``"0.5mm"``, ``rotation`` in rad or ``"0.05deg"``; or both in one text: root mean
        squares over the workspace. The errors are those of arms of that accuracy in position; with one in rotation, of
        the geometric mean of that and of the size that arms of such rotations have: the ratio differs from arm to arm.
        ``reach`` of the arm (m, or ``"0.9m"``); None takes the largest distance of the flange from the base.
        """
        exact = rotation is None and _is_exact(translation)
        move, turn = (0.0, 0.0) if exact else stated_accuracy(translation, rotation)
        length = None if reach is None else parse_length(reach, "`reach`")
        if length is not None and not 0 < length < np.inf:
            raise InputError(f"Expected `reach` to be above 0 and finite, got {reach!r}.")
        return population_error(move, turn, length)

    @property
    def needs_poses(self) -> bool:
        """True if it belongs to poses, its numbers or its columns, and is not `bound` to some yet."""
        return self.bind is not None

    def bound(self, poses: PosePairs) -> SharedError:
        """Bind the error to the poses where it belongs to poses; columns at other poses are of the same numbers.

        `calibrate` binds an error to its poses where that has not been done.
        """
        return self if self.bind is None else replace(self, bind=None, **self.bind(poses))

    def at(self, poses: PosePairs) -> Array:
        """F (n, 6, k) at these poses; raises `InputError` where they do not tell it."""
        return some_rows(self.factor_at(poses), slice(None))

    def factor_at(self, poses: PosePairs) -> Factor:
        """F (n, 6, k) at these poses, or what it is the product of."""
        F = self.effect(poses)
        if len(F[0] if isinstance(F, Products) else F) != poses.n:
            count = len(F[0] if isinstance(F, Products) else F)
            raise InputError(
                f"Expected the columns of the shared error {self.name!r} to cover {poses.n} poses, got {count}."
            )
        return F

    def to_dict(self) -> JsonObject:
        """Plain numbers and text that `from_dict` makes the error of; not of the user's own columns."""
        return {
            "key": self.key.to_dict(),
            "sd": self.sd.tolist(),
            **({} if self.factor == 1 else {"factor": self.factor}),
            **({"default": True} if self.default else {}),
            **({} if self.focal_length_px is None else {"focal_length_px": self.focal_length_px}),
            **({} if self.declared is None else {"accuracy": list(self.declared), "stated": self.stated}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> SharedError:
        """The inverse of `to_dict`; raises `InputError` for columns of the user's own, which it does not hold."""
        whose, focal_length = ErrorKey.from_dict(data["key"]), data.get("focal_length_px")
        key = whose.of("")
        known = (
            cls.focal_length,
            cls.principal_point,
            cls.target_scale,
            cls.camera_scale,
            cls.robot_scale,
            cls.clock_offset,
        )
        if key == ROBOT_ACCURACY:
            move, turn, reach = data["accuracy"]
            error = replace(cls.robot_accuracy(move, turn, reach=reach), stated=data["stated"])
        else:
            made = [error for make in known if (error := make(float(data["sd"][0]))).key == key]
            if not made:
                raise InputError(
                    f"The shared error {str(whose)!r} has columns of its own, which the file does not hold."
                )
            error = replace(made[0], focal_length_px=focal_length)
        found = replace(error, factor=float(data.get("factor", 1.0)), default=bool(data.get("default", False)))
        return found.of(whose.name)

    def rows(self, kept: NDArray[np.intp], n: int) -> SharedError:
        """Return the error for some of n poses, by their numbers: columns that were given for all n lose the others."""
        whole = self.effect

        def effect(poses: PosePairs) -> Factor:
            F = whole(poses)
            return rows_of_factor(F, kept) if len(F[0] if isinstance(F, Products) else F) == n != poses.n else F

        left = self.left[kept] if self.left is not None and len(self.left) == n else self.left
        return replace(self, effect=effect, left=left)

    def __repr__(self) -> str:
        return (
            f"SharedError({self.name!r}, sd={', '.join(f'{sd:.3g}' for sd in self.sd)}{self.unit and ' '}{self.unit})"
        )


def population_error(move: float, turn: float, reach: float | None) -> SharedError:
    """Return errors of arms with this accuracy (m, rad), to be bound to poses; ``reach`` (m) None: by the poses."""

    def bind(poses: PosePairs) -> dict[str, Any]:
        from .population import bound_population  # its table of arms takes a while

        population = bound_population(poses.robot.tobytes(), reach)
        K = population.here
        size = move
        if turn > 0:  # both state one size, but for the ratio of the two that an arm has: the mean of the logarithms
            by_turn = turn / float(np.sqrt((K[:, :3] ** 2).sum(axis=(1, 2)).mean()))
            size = float(np.sqrt(move * by_turn)) if move > 0 else by_turn
        keys = tuple(ROBOT_ACCURACY.number(k + 1) for k in range(K.shape[-1]))
        accuracy = RobotAccuracy(move, turn, population.reach)

        def effect(at: PosePairs) -> Array:
            near = at.n == poses.n and np.abs(at.robot - poses.robot).max() < SAME_POSE_SHARE * population.reach
            return K if near else population.columns(at.robot)

        return {
            "keys": keys,
            "sd": np.full(len(keys), size),
            "effect": effect,
            "accuracy": accuracy,
            "left": population.left,
            "unseen": lambda at, measured: population.unseen(at.robot, measured),
        }

    exact = not (move > 0 or turn > 0)
    words = f"{digits(1e3 * move, 2)} mm" + (f", {digits(np.degrees(turn), 2)} deg" if turn > 0 else "")
    return SharedError(
        ROBOT_ACCURACY, "", "robot", np.zeros(1) if exact else np.ones(1), (ROBOT_ACCURACY,), unbound, stated=words,
        bind=bind, declared=(move, turn, reach),
    )  # fmt: skip


def listed_errors(errors: Any) -> tuple[SharedError, ...]:
    """The errors, if they are some, and no two of one name."""
    if isinstance(errors, SharedError) or not isinstance(errors, Iterable):
        raise InputError(f"Expected `shared` to be a list of SharedError, got {type(errors).__name__}.")
    found = tuple(errors)
    for error in found:
        if not isinstance(error, SharedError):
            raise InputError(f"Expected `shared` to be a list of SharedError, got one of {type(error).__name__}.")
    names = [name for error in found for name in {str(error.key), *(str(key.of(error.key.name)) for key in error.keys)}]
    if twice := {name for name in names if names.count(name) > 1}:
        raise InputError(f"Expected one shared error of each name in `shared`, got two {sorted(twice)[0]!r}.")
    return found


def checked_errors(errors: Any, poses: PosePairs) -> tuple[SharedError, ...]:
    """The errors, if they are some, no two of one name, and the poses tell what they do."""
    found = tuple(error.bound(poses) if error.needs_poses else error for error in listed_errors(errors))
    for error in found:
        if not error.is_exact:
            error.at(poses)
    return found


def _is_exact(value: float | str) -> bool:
    return isinstance(value, str) and value.strip().lower() in EXACT


def _sd(value: float | str, name: object, parse: Callable[[str | float, str], float]) -> Array:
    sd = np.array([0.0 if _is_exact(value) else parse(value, f"the standard deviation of the {name}")])
    _require_sd(sd, name, value)
    return sd


def _require_sd(sd: Array, name: object, given: float | str | None = None) -> None:
    if not (np.isfinite(sd) & (sd >= 0)).all():
        got = sd.tolist() if given is None else repr(given)
        raise InputError(f"Expected the standard deviation of the {name} to be finite and >= 0, got {got}.")


def unbound(poses: PosePairs) -> Array:
    raise InputError(
        f"The columns of the errors {str(ROBOT_ACCURACY)!r} and {str(VIEW)!r} belong to poses; "
        "take SharedError.bound(poses) first."
    )


def of_intrinsics(some: slice) -> dict[str, Any]:
    """Effect of some of the intrinsics, and its change once width and place of the target follow from poses."""

    def of_target(distance: float | None = None, centre: Array | None = None) -> Callable[[PosePairs], Array]:
        # a copy, which does not keep the columns of the others
        return lambda poses: np.ascontiguousarray(intrinsics_columns(poses.camera, distance, centre)[..., some])

    def bind(poses: PosePairs) -> dict[str, Any]:
        distance = median_distance(poses.camera)
        return {"effect": of_target(distance, target_centre(poses.camera, distance))}

    return {"effect": of_target(), "bind": bind}


def _scale(side: str) -> Callable[[PosePairs], Array]:
    def effect(poses: PosePairs) -> Array:
        F = np.zeros((poses.n, 6, 1))
        F[:, 3:, 0] = getattr(poses, side)[:, :3, 3]
        return F

    return effect


def _rate(poses: PosePairs) -> Array:
    """Mean velocity (rad/s, m/s) between the robot poses before and after: that of a recording on the move."""
    if poses.timestamps is None or poses.n < 3:
        raise InputError(
            f"Expected poses with timestamps for the shared error {str(CLOCK_OFFSET)!r}, got "
            + ("none." if poses.timestamps is None else f"{poses.n} poses.")
        )
    order = np.argsort(poses.timestamps)
    t, T = poses.timestamps[order], poses.robot[order]
    before, after = np.maximum(np.arange(poses.n) - 1, 0), np.minimum(np.arange(poses.n) + 1, poses.n - 1)
    span = (t[after] - t[before])[:, None]
    turn = Rotation.from_matrix(T[after, :3, :3] @ T[before, :3, :3].mT).as_rotvec()
    rate = np.empty((poses.n, 6, 1))
    rate[order, :3, 0] = turn / span
    rate[order, 3:, 0] = (T[after, :3, 3] - T[before, :3, 3]) / span
    return rate


def the_same(F: Factor) -> Callable[[PosePairs], Factor]:
    """Effects that do not depend on the poses."""
    return lambda poses: F
