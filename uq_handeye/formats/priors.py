"""Reader of a prior of X or W from a file: a pose with its covariance, or an earlier result."""

from __future__ import annotations

import numpy as np

from ..core.files.open import StrPath, as_path, opened
from ..core.files.tree_values import Tree, is_map, items_of
from ..core.files.trees import parse_tree
from ..core.geometry.checks import as_transforms
from ..core.geometry.conventions import CovarianceReading
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array
from ..core.limits import MAX_DESCRIPTION_BYTES
from ..errors import InputError
from .ros_messages import MessageError, poses_in

# Field of a file of `export` that holds the pose with its covariance.
OF_ROS = "pose_with_covariance_stamped"
READING = ("convention", "information", "of", "pixel_sd")
KEYS = ("pose", "translation", "quaternion", "covariance", "std", *READING)
_FORM = (
    "'pose' (4 x 4), or 'translation' and 'quaternion' (x, y, z, w), with 'covariance' (6 x 6) or 'std' (6) of "
    "(theta, tau) in rad and m, null where nothing is known"
)


def read_prior(path: StrPath, of: str = "X") -> tuple[Array, Array]:
    """Read the prior of X or W from a YAML or JSON file, as ``prior_X`` or ``prior_W`` of `calibrate`.

    Parameters
    ----------
    path : path of the file
        Either a mapping with ``pose`` (4 x 4, metres), or ``translation`` (3) and ``quaternion`` (x, y, z, w), and
        ``covariance`` (6 x 6) or ``std`` (6) of ``xi = (theta, tau)`` in rad and m: left rotation, additive
        translation, in the parent frame of the pose. ``null`` in ``std``, and on the diagonal of ``covariance``, is a
        component that is not known. Beside ``covariance`` may stand ``convention``, ``information``, ``of`` and
        ``pixel_sd`` as in noise files. Or the JSON of an earlier result, whose open components are not known; or
        ``geometry_msgs/PoseWithCovarianceStamped`` as ``export`` and ``ros2 topic echo`` write it.
    of : "X" or "W"
        Which pose of an earlier result.

    Returns
    -------
    (pose (4, 4), covariance (6, 6)), infinite on the diagonal where nothing is known.

    Raises
    ------
    InputError
        A file that cannot be read or that holds something else, also a key that is not known.
    """
    target = as_path(path)
    with opened(target, MAX_DESCRIPTION_BYTES) as file:
        tree = parse_tree(file.read(), str(target))
    if not is_map(tree):
        raise InputError(f"{target}: expected {_FORM}, or an earlier result.")
    if str(tree.get("format", "")).startswith("uq-handeye calibration"):
        return _of_result(tree, of, str(target))
    stamped = tree.get(OF_ROS, tree)
    if is_map(stamped) and is_map(message := stamped.get("pose")):
        return _of_message(message, str(target))
    if unknown := [key for key in tree if key not in KEYS]:
        raise InputError(f"{target}: unknown key {unknown[0]!a:.40}; expected {_FORM}, and {', '.join(READING)}.")
    stated = {key: tree[key] for key in READING if key in tree}
    if stated and "covariance" not in tree:
        raise InputError(f"{target}: {next(iter(stated))} is for a covariance. Remove it.")
    if ("covariance" in tree) == ("std" in tree):
        raise InputError(f"{target}: expected either 'covariance' or 'std', {_FORM}.")
    try:
        if "pose" in tree:
            pose = np.array(tree["pose"], dtype=float)
        else:
            pose = np.eye(4)
            pose[:3, :3] = Rotation.from_quat(np.array(tree["quaternion"], dtype=float)).as_matrix()
            pose[:3, 3] = tree["translation"]
        if "std" in tree:
            covariance = np.diag(_numbers(tree["std"], (6,)) ** 2)
        else:
            covariance = _numbers(tree["covariance"], (6, 6))
        reading = CovarianceReading(
            str(stated.get("convention", "toolkit")),
            _one_of(stated.get("of", "pose"), {"pose": False, "inverse": True}),
            _one_of(stated.get("information", False), {False: False, True: True}),
            float(str(stated["pixel_sd"])) if "pixel_sd" in stated else None,
        )
    except InputError as error:
        raise InputError(f"{target}: {error}") from error
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{target}: expected {_FORM}, got {error}.") from error
    pose = as_transforms(pose, str(target), stack=False)
    if not stated:
        return pose, covariance
    if not np.isfinite(covariance).all():
        raise InputError(
            f"{target}: expected every number of a covariance in another convention to be known, got null."
        )
    return pose, reading.read(covariance, pose, str(target))


def _one_of(value: Tree, meanings: dict[str | bool, bool]) -> bool:
    if not isinstance(value, str | bool) or value not in meanings:
        raise ValueError(f"{value!r} in place of {' or '.join(map(str, meanings)).lower()}")
    return meanings[value]


def _of_message(message: dict[str, Tree], name: str) -> tuple[Array, Array]:
    """Return the pose of a PoseWithCovariance of ROS; its covariance is in the convention of ROS."""
    try:
        (found,) = poses_in(message)
        numbers = np.array([float(x) for x in items_of(message.get("covariance"))])
    except (MessageError, TypeError, ValueError) as error:
        raise InputError(f"{name}: expected geometry_msgs/PoseWithCovariance, got {error}.") from error
    if numbers.shape != (36,):
        raise InputError(f"{name}: expected a pose with 36 numbers of its covariance, got {numbers.size}.")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_quat(found.numbers[3:]).as_matrix(), found.numbers[:3]
    pose = as_transforms(pose, name, stack=False)
    return pose, CovarianceReading("ros").read(numbers.reshape(6, 6), pose, name)


def _numbers(value: Tree, shape: tuple[int, ...]) -> Array:
    """Infinity for null."""
    S = np.array(value, dtype=object)
    if S.shape != shape:
        raise ValueError(f"an array of shape {S.shape}")
    return np.array([np.inf if x is None else float(x) for x in S.ravel()]).reshape(shape)


def _of_result(tree: dict[str, Tree], of: str, name: str) -> tuple[Array, Array]:
    pose, covariance = tree.get(of), tree.get("covariance" if of == "X" else "covariance_W")
    std = tree.get("std" if of == "X" else "std_W")
    if pose is None or covariance is None or std is None:
        raise InputError(f"{name}: this result holds no {of} with a covariance.")
    S = np.array(covariance, dtype=float)
    unknown = np.array([value is None for value in items_of(std)])
    S[unknown], S[:, unknown] = 0.0, 0.0
    S[unknown, unknown] = np.inf
    return as_transforms(pose, name, stack=False), S
