"""Reading of a camera calibration from its folder, or from the object that holds the same; nothing is estimated again.

The consistency of its parts is checked: the residuals must follow from poses, intrinsics and corners.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.files.json_values import Json, JsonObject
from ...core.files.one_line import OF_DATA, refused, short
from ...core.files.open import StrPath, shown
from ...core.files.records import array_of
from ...core.files.tree_values import fields_of, got, is_list, item, number, vector
from ...core.geometry.checks import as_transforms
from ...core.geometry.se3 import Array
from ...core.rounding import CHAIN_ROUNDING
from ...errors import InputError
from ...findings import Finding
from ...formats.command_folder import arrays_in, description_in, fields_of_format, folder_of_command
from ...formats.csv_poses import read_pose_file
from .adjustment.bundle import Bundle, BundleUnknowns, Prior, Sight
from .adjustment.criterion import Candidate
from .adjustment.outliers import MAX_DISTANCE_SD
from .board_pattern import board_pattern_of
from .board_shape import BoardShape
from .calibration_files import CORNERS, COVARIANCE, INTRINSICS, POSES
from .corners import Corners
from .corners_file import corners_and_used
from .given_intrinsics import GivenIntrinsics
from .intrinsics_file import FORMAT
from .models import MODELS
from .residual_pattern import pattern_of
from .result import CameraCalibration

_OTHER_RUN = "not of the same run, or one was changed by hand; write the folder again with uq-handeye camera."


def read_camera(folder: StrPath) -> CameraCalibration:
    """The calibration that `CameraCalibration.write` wrote, exactly; nothing is estimated again.

    Raises
    ------
    InputError
        A folder that is none, lacks a file, or whose files do not belong together.
    """
    path = folder_of_command(folder, "camera", (INTRINSICS, COVARIANCE, CORNERS, POSES))
    name, tree = shown(path), description_in(path / INTRINSICS, FORMAT)
    corners, used = corners_and_used(path / CORNERS)
    arrays = arrays_in(path / COVARIANCE)
    with refused(f"{name}: not what uq-handeye camera writes", OF_DATA):
        found = calibration_from_parts(tree, corners, used, arrays, shown(path / INTRINSICS))
        _numbers(arrays, "shared", found.covariance.shared.shape)
    rows, poses = read_pose_file(path / POSES)
    if not (
        np.array_equal(rows, found.rows)
        and np.array_equal(arrays["rows"], found.rows)
        and np.abs(poses - found.poses).max() < CHAIN_ROUNDING * max(1.0, float(np.abs(found.poses).max()))
    ):
        raise InputError(f"{name}: {POSES}, {COVARIANCE} and {CORNERS} are {_OTHER_RUN}")
    return found


def _list(value: Json, where: str) -> Sequence[Json]:
    """Return the items of a list; raises `InputError` for anything else."""
    if not is_list(value):
        raise InputError(f"{where}: expected a list, got {got(value)}.")
    return value


def _numbers(arrays: Mapping[str, ArrayLike], key: str, shape: tuple[int, ...]) -> Array:
    return array_of(arrays.get(key, ()), shape, f"{key} of {COVARIANCE}")


def _prior(value: Json, free: NDArray[np.bool_], where: str) -> Prior | None:
    """Return the prior of the fit; that of parameters that are not estimated is not used, and may be singular."""
    if value is None:
        return None
    k = len(free)
    mean = np.array(vector(item(value, "mean", where), k, f"{where}, mean"), dtype=np.float64)
    S = np.array(
        [vector(row, k, f"{where}, covariance") for row in _list(item(value, "covariance", where), where)], dtype=float
    )
    if S.shape != (k, k) or (S != S.T).any() or np.linalg.eigvalsh(S[np.ix_(free, free)]).min(initial=1.0) <= 0:
        raise InputError(f"{where}, covariance: expected one, {k} x {k}, positive definite for what was estimated.")
    return Prior(mean, S)


def _given(value: Json, where: str) -> GivenIntrinsics | None:
    """Return the numbers that were given beforehand."""
    if value is None:
        return None
    pairs = {key: vector(pair, 2, f"{where}, {key}") for key, pair in fields_of(item(value, "values", where)).items()}
    return GivenIntrinsics({key: (mean, sd) for key, (mean, sd) in pairs.items()}, item(value, "exact", where) is True)


def _shape(board: JsonObject, arrays: Mapping[str, ArrayLike]) -> BoardShape:
    """Return the shape of the board."""
    names = tuple(map(str, _list(board["names"], "board, names")))
    u, q = len(np.asarray(arrays["board_points"])), len(names)
    sd = np.asarray(arrays["board_sd"], dtype=float)
    if sd.shape != (q,) or not (sd > 0).all():
        raise InputError(
            f"{COVARIANCE}, board_sd: expected {q} standard deviations above 0; the files are {_OTHER_RUN}"
        )
    parts = {"points": (u, 3), "offset": (u, 3), "fields": (u, 3, q)}
    points, offset, fields = (_numbers(arrays, f"board_{part}", shape) for part, shape in parts.items())
    return BoardShape(str(board["shape"]), names, points, offset, fields, sd)


def _candidate(one: JsonObject, name: str) -> Candidate:
    """A camera model that was compared; None in the file stands for an infinite number."""
    bic, rms = (float("inf") if one[key] is None else number(one[key], f"{name}, {key}") for key in ("bic", "rms"))
    return Candidate(
        str(one["model"]),
        tuple(map(str, _list(one["coefficients"], f"{name}, coefficients"))),
        bic,
        rms,
        str(one["board"]),
    )


def calibration_from_parts(
    data: Json, corners: Corners, used: NDArray[np.bool_], arrays: Mapping[str, ArrayLike], name: str
) -> CameraCalibration:
    """The calibration of what `to_dict` and `bundle_arrays` wrote, its corners and which were used.

    Raises
    ------
    InputError
        Parts that do not belong together; KeyError, TypeError, ValueError or IndexError on anything else.
    """
    tree = fields_of_format(data, FORMAT, name)
    if (called := str(tree["model"])) not in MODELS:
        raise InputError(f"{name}, model: expected one of {', '.join(MODELS)}, got {short(called)}.")
    model, board = MODELS[called], fields_of(tree["board"])
    k, n = len(model.names), corners.n
    shape = _shape(board, arrays)
    p = k + shape.q
    parameters = np.array([number(item(tree["parameters"], key, name), f"{name}, {key}") for key in model.names])
    of_lens = np.array(
        [vector(row, k, f"{name}, covariance") for row in _list(tree["covariance"], f"{name}, covariance")]
    )
    bend = vector(board["coefficients"], shape.q, f"{name}, board")
    parameters = np.concatenate([parameters, np.array(bend, dtype=float)])
    covariance = _numbers(arrays, "covariance", (p, p))
    if of_lens.shape != (k, k) or (covariance != covariance.T).any():
        raise InputError(f"{name}, covariance: expected a symmetric matrix, {k} x {k}.")
    if not np.array_equal(covariance[:k, :k], of_lens):
        raise InputError(f"{name} and {COVARIANCE} are {_OTHER_RUN}")
    width, height = (int(number(value, f"{name}, image_size")) for value in vector(tree["image_size"], 2, name))
    poses = as_transforms(_numbers(arrays, "poses", (n, 4, 4)), "poses")
    own = _numbers(arrays, "own", (n, 6, 6))
    by_parameters = _numbers(arrays, "by_parameters", (n, 6, p))
    weights = _numbers(arrays, "weights", (n,))
    if (weights <= 0).any():
        raise InputError(f"{COVARIANCE}, weights: expected weights of the pictures above 0, got {weights.min():.3g}.")
    free = np.isin(
        (*model.names, *shape.names), [*map(str, _list(tree["estimated"], f"{name}, estimated")), *shape.names]
    )
    if not np.array_equal(_numbers(arrays, "parameters", (p,)), parameters):
        raise InputError(f"{name} and {COVARIANCE} are {_OTHER_RUN}")
    if (own != own.mT).any() or np.linalg.eigvalsh(own).min() < 0:
        raise InputError(f"{COVARIANCE}, own: expected covariances, got other matrices.")
    try:
        sight = Sight.of(model, shape, corners, used)
    except InputError as error:
        raise InputError(f"{CORNERS} and {COVARIANCE} are {_OTHER_RUN}") from error
    predicted = sight.predicted(parameters, poses)[corners.picture, corners.place]
    bundle = Bundle(
        BundleUnknowns(model, shape, free, _prior(tree.get("prior"), free, f"{name}, prior")),
        parameters,
        poses,
        corners.pixels - predicted,
        used,
        number(tree["pixel_noise"], f"{name}, pixel_noise"),
        covariance,
        own,
        by_parameters,
        weights,
        bool(tree["converged"]),
        int(number(tree["iterations"], f"{name}, iterations")),
    )
    candidates = tuple(
        _candidate(one, name) for one in map(fields_of, _list(tree["candidates"], f"{name}, candidates"))
    )
    size = (width, height)
    corners = Corners(
        corners.row,
        corners.points,
        corners.pixels,
        corners.names,
        image_size=size,
        missing=tuple(map(str, _list(tree["pictures_without_board"], f"{name}, pictures_without_board"))),
        board=str(board["printed"]),
    )
    found = CameraCalibration(
        bundle,
        corners,
        size,
        candidates,
        pattern_of(bundle, corners, size),
        board_pattern_of(bundle, corners),
        tuple(map(Finding.from_dict, _list(tree["findings"], f"{name}, findings"))),
        _given(tree.get("given"), f"{name}, given"),
    )
    if np.sqrt(np.mean(bundle.residuals[used] ** 2)) > MAX_DISTANCE_SD * bundle.pixel_noise + 1e-6:
        raise InputError(
            f"{CORNERS} does not fit the poses and intrinsics of its folder: it is of another run, or changed."
        )
    if free.any() and np.linalg.eigvalsh(covariance[np.ix_(free, free)]).min() <= 0:
        raise InputError(f"{name}, covariance: expected one that is positive definite for the estimated parameters.")
    return found


def camera_from_dict(data: JsonObject, poses: Array) -> CameraCalibration:
    """Return the inverse of `camera_to_dict`, with the poses ``camera_T_target`` (n, 4, 4).

    Raises
    ------
    InputError
        Anything else.
    """
    try:
        seen = fields_of(data["seen"])
        points = np.array(seen["points"], dtype=float)
        which = _plain_numbers(seen["point"], len(points))
        row = _plain_numbers(seen["row"], None)
        corners = Corners(row, points[which], np.array(seen["pixels"], dtype=float), seen["names"])
        used = np.ones(corners.m, dtype=bool)
        used[_plain_numbers(seen["left_out"], corners.m)] = False
        if corners.n != len(poses) or (np.diff(row) < 0).any():
            raise InputError(f"{corners.n} pictures, and {len(poses)} poses")
        arrays = {name: np.array(value, dtype=float) for name, value in fields_of(data["arrays"]).items()} | {
            "poses": poses
        }
        if (sd := arrays.get("board_sd")) is not None:  # None in the file: nothing is known of the shape beforehand
            arrays["board_sd"] = np.where(np.isnan(sd), np.inf, sd)
        return calibration_from_parts(data, corners, used, arrays, "camera_calibration")
    except (InputError, KeyError, TypeError, ValueError, LookupError, ArithmeticError) as error:
        raise InputError(f"data.camera_calibration is damaged ({str(error).rstrip('.')})") from error


def _plain_numbers(values: ArrayLike, below: int | None) -> NDArray[np.intp]:
    """Integers from 0 (and below a count); raises `InputError`."""
    found = np.array(values, dtype=float)
    if found.ndim != 1 or (found != np.floor(found)).any() or (found < 0).any():
        raise InputError("expected numbers from 0")
    if below is not None and (found >= below).any():
        raise InputError(f"expected numbers below {below}")
    return found.astype(np.intp)
