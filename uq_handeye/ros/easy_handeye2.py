"""Backend for easy_handeye2: its samples give X with its covariance.

The server of easy_handeye2 has ``calibration_backends``, a dict of objects with ``AVAILABLE_ALGORITHMS`` and
``compute_calibration(node, parameters, samples, algorithm)``, which returns a ``HandeyeCalibration``
(marcoesposito1988/easy_handeye2: ``easy_handeye2/easy_handeye2/handeye_server.py`` and
``handeye_calibration_backend_opencv.py``, ``easy_handeye2_msgs/msg``). ``EasyHandeyeBackend`` is such an object; the
one of easy_handeye (ROS 1) is called without the node, and has other names of fields. Samples are
``geometry_msgs/Transform``, ``robot`` and ``tracking`` (``optical``): of a camera on the hand ``base_T_gripper`` and
``camera_T_target``; of one in the cell the robot's are ``gripper_T_base``, as the sampler looks them up.

ROS messages are those of easy_handeye2 where it is installed; without it the result has the same fields.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..calibration.calibrate import calibrate
from ..calibration.result import Calibration
from ..core.files.open import StrPath, as_path
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array, inverse
from ..core.limits import MIN_POSES
from ..errors import InputError, InputWarning, NotConvergedError
from ..formats.ros_messages import Message
from ..model.poses.pose_pairs import PosePairs

# Names that its window shows, and the method of each.
ALGORITHMS = {
    "Efficient": "efficient",
    "Maximum-likelihood": "ml",
    "4DPA": "4dpa",
    "Tsai-Lenz": "tsai",
    "Park": "park",
    "Horaud": "horaud",
    "Andreff": "andreff",
    "Daniilidis": "daniilidis",
    "Shah": "shah",
}
# Levels of warnings, by the name that a log has.
WARN = ("warning", "warn")
# What the tools call the mount of the camera.
SETUPS = {
    "eye_in_hand": "eye-in-hand",
    "eye_on_hand": "eye-in-hand",
    "eye_on_base": "eye-to-hand",
    True: "eye-in-hand",
    False: "eye-to-hand",
}


class EasyHandeyeBackend:
    """Calibration backend of easy_handeye2 that keeps the covariance of X.

    Parameters
    ----------
    folder : path or None
        Folder for ``NAME_uq.json`` (the whole result) and ``NAME_uq.yaml`` (X with its covariance for ROS) after each
        calibration; None writes none.
    options : arguments of `calibrate`
        Such as ``noise``, ``shared`` or ``robust``.

    Attributes
    ----------
    last_result : Calibration or None
        The last X with its covariance, findings and report, also if it is not usable.
    last_poses : PosePairs or None
        The samples that it was computed from.

    Examples
    --------
    >>> from uq_handeye.ros.easy_handeye2 import EasyHandeyeBackend
    >>> server.calibration_backends["UQ"] = EasyHandeyeBackend()  # doctest: +SKIP
    >>> server.calibration_algorithm = "UQ/Efficient"             # doctest: +SKIP
    """

    MIN_SAMPLES = 3
    AVAILABLE_ALGORITHMS = ALGORITHMS

    def __init__(self, folder: StrPath | None = None, **options: Any) -> None:
        self.folder = None if folder is None else as_path(folder)
        self.options = options
        self.last_result: Calibration | None = None
        self.last_poses: PosePairs | None = None

    def compute_calibration(self, *given: Any, algorithm: str | None = None) -> Any:
        """Return the ``HandeyeCalibration`` of samples, or None if they give none that is usable; the log says why.

        Parameters
        ----------
        given : (node, parameters, samples) or (parameters, samples)
            As easy_handeye2 and easy_handeye call their backends; a fourth one is the algorithm.
        algorithm : str or None
            One of ``AVAILABLE_ALGORITHMS``; None is Efficient.
        """
        node, parameters, samples, algorithm = _arguments(given, algorithm)
        log = _log(node)
        self.last_result = self.last_poses = None
        try:
            self.last_poses = poses = poses_of_samples(parameters, samples, self.MIN_SAMPLES)
            method = self.AVAILABLE_ALGORITHMS.get(algorithm or "Efficient")
            if method is None:
                names = ", ".join(self.AVAILABLE_ALGORITHMS)
                raise InputError(f"Expected the algorithm to be one of {names}, got {algorithm!r}.")
            with warnings.catch_warnings():  # they go to the log
                warnings.simplefilter("ignore", InputWarning)
                self.last_result = result = calibrate(poses, method=method, **self.options)
        except (InputError, NotConvergedError) as error:
            log(f"No calibration: {error}", *WARN)
            return None
        log(result.headline, *(() if result.usable else ("error",)))
        for warning in result.warnings:
            log(warning, *WARN)
        if self.folder is not None:
            try:
                log(f"Wrote {_write(result, self.folder, _name_of(parameters))}.")
            except (InputError, OSError) as error:
                log(f"The result was not written to {self.folder}: {error}", *WARN)
        return _calibration(parameters, result.X) if result.usable else None


def poses_of_samples(parameters: Message, samples: Message, fewest: int = MIN_POSES) -> PosePairs:
    """Return the samples of easy_handeye2 or easy_handeye as `PosePairs`.

    Parameters
    ----------
    parameters : HandeyeCalibrationParameters
        ``calibration_type`` (or ``eye_on_hand``) says the setup.
    samples : SampleList or list
        Samples with ``robot`` and ``tracking``, or dicts with ``robot`` and ``optical``.

    Raises
    ------
    InputError
        Fewer than ``fewest`` samples, fields that are missing, numbers that are no pose, an unknown setup.
    """
    items = list(_field(samples, "samples") if _field(samples, "samples") is not None else samples)
    if len(items) < fewest:
        raise InputError(f"Expected at least {fewest} samples, got {len(items)}: take more.")
    robot, camera = (
        np.array([_matrix(_side(sample, names), f"sample {k}, {names[0]}") for k, sample in enumerate(items)])
        for names in (("robot",), ("tracking", "optical"))
    )
    setup = _setup(parameters)
    return PosePairs(inverse(robot) if setup == "eye-to-hand" else robot, camera, setup=setup)


def _log(node: Any) -> Callable[..., None]:
    """Return what logs a text by the first of some levels that the log of the node has, else as information."""
    get = getattr(node, "get_logger", None)
    logger = get() if callable(get) else None

    def say(text: str, *levels: str) -> None:
        for level in (*levels, "info"):
            if callable(known := getattr(logger, level, None)):
                known(text)
                return

    return say


def _arguments(given: tuple[Any, ...], algorithm: str | None) -> tuple[Any, Any, Any, str | None]:
    """Return node, parameters, samples and algorithm of both ways to call a backend."""
    if given and isinstance(given[-1], str):
        *most, algorithm = given
        given = tuple(most)
    if len(given) not in (2, 3):
        raise InputError(f"Expected (node, parameters, samples) or (parameters, samples), got {len(given)} arguments.")
    node = given[0] if len(given) == 3 else None
    return node, given[-2], given[-1], algorithm


def _field(value: Message, name: str) -> Message:
    """Return a field of a message or an item of a dict, or None."""
    return value.get(name) if isinstance(value, Mapping) else getattr(value, name, None)


def _side(sample: Message, names: tuple[str, ...]) -> Message:
    for name in names:
        if (found := _field(sample, name)) is not None:
            return _field(found, "transform") if _field(found, "transform") is not None else found
    raise InputError(f"Expected samples with {' or '.join(names)}, got {type(sample).__name__} without.")


def _matrix(transform: Message, where: str) -> Array:
    """Return a ``geometry_msgs/Transform`` as (4, 4)."""
    values = []
    for part, axes in (("translation", "xyz"), ("rotation", "xyzw")):
        for axis in axes:
            if (value := _field(_field(transform, part), axis)) is None:
                raise InputError(f"{where}: expected {part}.{axis}, got none.")
            values.append(float(value))
    if not np.isfinite(values).all() or abs(np.linalg.norm(values[3:]) - 1.0) > 1e-3:
        raise InputError(f"{where}: expected finite numbers and a unit quaternion, got {values}.")
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_quat(values[3:]).as_matrix(), values[:3]
    return T


def _setup(parameters: Message) -> str:
    says = _field(parameters, "calibration_type")
    if says in (None, ""):
        says = _field(parameters, "eye_on_hand")
    if says is None:
        return "eye-in-hand"
    if not isinstance(says, str | bool) or says not in SETUPS:
        raise InputError(f"Expected calibration_type to be eye_in_hand or eye_on_base, got {says!r}.")
    return SETUPS[says]


def _name_of(parameters: Message) -> str:
    """Return the name of the calibration, without what leads out of a folder."""
    name = str(_field(parameters, "name") or "calibration")
    return (
        "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name).lstrip(".") or "calibration"
    )


def _write(result: Calibration, folder: Path, name: str) -> str:
    folder.mkdir(parents=True, exist_ok=True)
    whole, ros = folder / f"{name}_uq.json", folder / f"{name}_uq.yaml"
    result.to_json(whole)
    result.export(ros, "ros")
    return f"{whole} and {ros}"


def _calibration(parameters: Message, X: Array) -> Message:
    """Return X as the message of easy_handeye2, of easy_handeye, or with the same fields where neither is installed."""
    x, y, z = map(float, X[:3, 3])
    qx, qy, qz, qw = map(float, Rotation.from_matrix(X[:3, :3]).as_quat())
    try:
        from geometry_msgs.msg import Quaternion, Transform, Vector3

        transform = Transform(translation=Vector3(x=x, y=y, z=z), rotation=Quaternion(x=qx, y=qy, z=qz, w=qw))
    except ImportError:
        transform = SimpleNamespace(
            translation=SimpleNamespace(x=x, y=y, z=z), rotation=SimpleNamespace(x=qx, y=qy, z=qz, w=qw)
        )
    try:
        from easy_handeye2.handeye_calibration import HandeyeCalibration
    except ImportError:
        return SimpleNamespace(parameters=parameters, transform=transform)
    try:
        return HandeyeCalibration(parameters=parameters, transform=transform)
    except (TypeError, AssertionError):  # the class of earlier versions
        return HandeyeCalibration(calibration_parameters=parameters, transformation=transform)
