r"""Errors that are assumed where none are declared: those of camera and target, of a lens, of an arm, and drift.

*Drift*: a camera mount or a target that creeps while the poses are taken. Model: a random walk of six components
(theta, tau) over the poses in the order of their time, each with one standard deviation a step (rad, m). Its slow part
is in the first six terms of the Karhunen-Loeve expansion over n steps,

    b(i) = sum_k z_k sqrt(2 n) sin((k - 1/2) pi i / n) / ((k - 1/2) pi)

so that drift has six columns for each term. Either the *camera* moves, about its own origin (a left error of
``camera_T_target``), or the *target*, about its own (a right one). There is no drift where there are no timestamps, as
the order of the rows of a file has no meaning.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...core.geometry.se3 import Array
from ..errors.columns import Products
from ..errors.key import ErrorKey, Owner
from ..errors.keys import (
    DRIFTS,
    FOCAL_LENGTH,
    LENS,
    OUTLINE,
    PRINCIPAL_POINT,
    ROBOT_ACCURACY,
    TARGET_SCALE,
    VIEW,
)
from ..errors.sizes import CLASSES, SIZES
from ..poses.pose_pairs import PosePairs
from .shared_error import SharedError, of_intrinsics, population_error, the_same, unbound
from .view import LENS_SHARES, columns_about, median_distance, outline_columns, target_centre, view_scale


def drift_columns(
    camera: Array, timestamps: Array, target: bool, walked: Array | None = None, terms: int = 6
) -> Products:
    """(m, 6, 6 k) columns at poses (m, 4, 4) camera_T_target, per step of 1 rad and 1 m.

    ``walked`` (n,): times of the poses from one to the next of which the walk goes; None: of these. ``terms`` k of the
    expansion, at most n.
    """
    steps = np.sort(timestamps if walked is None else walked)
    n = len(steps)
    rate = (np.arange(1, min(terms, n) + 1) - 0.5) * np.pi
    at, place = np.arange(1, n + 1), np.interp(timestamps, steps, np.arange(1, n + 1))
    mean, walk = (np.sqrt(2.0 * n) * np.sin(np.outer(k / n, rate)) / rate for k in (at, place))
    walk = walk - mean.mean(axis=0)  # the mean is in X or W
    E = np.broadcast_to(np.eye(6), (len(camera), 6, 6))
    if target:
        E = np.zeros((len(camera), 6, 6))
        E[:, :3, :3] = E[:, 3:, 3:] = camera[:, :3, :3]
    return Products(walk, E)


def default_errors(intrinsics_known: bool) -> tuple[SharedError, ...]:
    """Return the errors that camera poses share by default: the size of the target, and for finished poses the effect
    of the intrinsics and what else follows from the view.

    ``intrinsics_known``: the covariance of the camera poses holds that already, as from corners.
    """
    size = SharedError.target_scale(SIZES[TARGET_SCALE].median)
    errors = (size,) if intrinsics_known else (SharedError.focal_length(), SharedError.principal_point(), size)
    return tuple(replace(error, factor=SIZES[error.key].factor, default=True) for error in errors)


def assumed_view() -> SharedError:
    """Return errors of finished camera poses that follow from the view (`view`), to be bound to poses."""
    size = SIZES[VIEW]

    def bind(poses: PosePairs) -> dict[str, Any]:
        mean, scale = view_scale(poses.camera)
        keys = tuple(VIEW.number(k + 1) for k in range(36))
        return {
            "keys": keys,
            "sd": np.full(36, size.median),
            "effect": lambda at: columns_about(at.camera, mean, scale),
        }

    return SharedError(
        VIEW, "", "camera", np.array([size.median]), (VIEW,), unbound, factor=size.factor, bind=bind, default=True
    )


def assumed_outline() -> SharedError:
    """Return what the unknown outline of the target changes in the effects of the intrinsics, to be bound to poses.

    Of the 32 products of an error of the intrinsics with a change of the outline (`view.outline_columns`), of usual
    sizes, the 12 principal ones at the poses.
    """
    size = SIZES[OUTLINE]
    count = 12
    of_lens = SIZES[LENS].median * LENS_SHARES
    usual = np.tile([SIZES[FOCAL_LENGTH].median, *[SIZES[PRINCIPAL_POINT].median] * 2, *of_lens], 4)

    def bind(poses: PosePairs) -> dict[str, Any]:
        distance = median_distance(poses.camera)
        centre = target_centre(poses.camera, distance)
        K = usual * outline_columns(poses.camera, distance, centre)
        rows = (K * np.repeat([distance, 1.0], 3)[:, None]).reshape(-1, K.shape[-1])
        axes = np.linalg.svd(rows.T @ rows)[0][:, :count]
        axes *= np.sign(axes[np.abs(axes).argmax(axis=0), range(count)])  # the same wherever it is bound again
        turn = usual[:, None] * axes
        return {
            "keys": tuple(OUTLINE.number(k + 1) for k in range(count)),
            "sd": np.full(count, size.median),
            "effect": lambda at: outline_columns(at.camera, distance, centre, turn),
        }

    return SharedError(
        OUTLINE, "", "camera", np.array([size.median]), (OUTLINE,), unbound, factor=size.factor, bind=bind, default=True
    )


def assumed_lens() -> SharedError:
    """Return errors of the distortion of the lens that finished camera poses were made with."""
    size = SIZES[LENS]
    keys = tuple(LENS.number(name) for name in ("k1", "k2", "p1", "p2", "fx/fy"))
    sd = size.median * LENS_SHARES
    return SharedError(
        LENS,
        "",
        "camera",
        sd,
        keys,
        factor=size.factor,
        default=True,
        **of_intrinsics(slice(3, None)),
    )


# Assumed errors of finished camera poses that follow from the views.
OF_VIEWS = {LENS: assumed_lens, OUTLINE: assumed_outline, VIEW: assumed_view}


def stored_error(data: Mapping[str, Any]) -> SharedError:
    """Return the error of `SharedError.to_dict`; those of the views are the assumed ones, or switched off."""
    key = ErrorKey.from_dict(data["key"])
    if key not in OF_VIEWS:
        return SharedError.from_dict(data)
    error = OF_VIEWS[key]()
    return error if any(data["sd"]) else error.switched_off()


def assumed_drift(poses: PosePairs, min_poses: int = 6) -> tuple[SharedError, ...]:
    """Return drifts of camera and target over the time of these poses.

    There are none without timestamps, in a simulation, and with fewer poses, which cannot show any.
    """
    if poses.timestamps is None or poses.truth is not None or poses.n < min_poses:
        return ()
    found = []
    for of, key in DRIFTS.items():
        F, size = drift_columns(poses.camera, poses.timestamps, of == Owner.TARGET), SIZES[key]
        keys = tuple(key.number(k + 1) for k in range(F.width))
        sd = np.full(len(keys), size.median)
        found.append(SharedError(key, "", "camera", sd, keys, the_same(F), factor=size.factor, default=True))
    return tuple(found)


def error_by_number(key: ErrorKey) -> tuple[SharedError, int] | None:
    """Return the error that a number belongs to and its place there, if poses alone determine its effect."""
    known = (
        SharedError.focal_length,
        SharedError.principal_point,
        SharedError.target_scale,
        SharedError.camera_scale,
        SharedError.robot_scale,
        assumed_lens,
    )
    for error in (make() for make in known):
        if key in error.keys:
            return error, error.keys.index(key)
    return None


def bound_again(key: ErrorKey, poses: PosePairs, reach: float | None = None) -> SharedError | None:
    """Return the error of this key whose numbers belong to poses, bound to them; None for others.

    ``reach`` (m) of the robot that it was bound with.
    """
    if key == ROBOT_ACCURACY:
        return population_error(1.0, 0.0, reach).bound(poses)
    return OF_VIEWS[key]().bound(poses) if key in (OUTLINE, VIEW) else None


def assumed_accuracy(of_class: str | None = None) -> SharedError:
    """Return the accuracy of a robot of which nothing is declared, or its class (`sizes.CLASSES`)."""
    size = SIZES[ROBOT_ACCURACY] if of_class is None else CLASSES[of_class]
    return replace(population_error(size.median, 0.0, None), default=True, factor=size.factor)


def replace_defaults(declared: Iterable[SharedError], intrinsics_known: bool, others: bool = True) -> list[SharedError]:
    """Return the default errors, those declared in place of the ones of their keys, and the other ones declared.

    ``others`` False: the defaults that are not declared are switched off.
    """
    by_key = {
        error.key: error if others else error.switched_off()
        for error in (
            *default_errors(intrinsics_known),
            assumed_accuracy(),
            *(() if intrinsics_known else (make() for make in OF_VIEWS.values())),
        )
    }
    return list((by_key | {error.key: error for error in declared}).values())
