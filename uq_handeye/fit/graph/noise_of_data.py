"""The noise of a data set, estimated from its own residuals, with the report and the findings about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...core.geometry.checks import as_transforms
from ...core.geometry.se3 import Array
from ...errors import InputError
from ...model.errors.camera_noise import CameraNoise
from ...model.errors.key import ErrorKey
from ...model.errors.models import PoseNoise
from ...model.errors.noise_estimate import NoiseEstimate
from ...model.errors.sizes import Size
from ...model.errors.square_roots import Covariance
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ...model.shared_errors.shared_error import SharedError, checked_errors
from .constraint import OnPoses, constraint_of
from .estimation import JointModel
from .noise_report import noise_estimate_of
from .starts import sound_start, start_of


def estimate_noise(
    data: PosePairs | Motions,
    prior: Mapping[ErrorKey, Size] | None = None,
    *,
    start: Array | None = None,
    weights: Array | None = None,
    camera: CameraNoise | None = None,
    robot: Covariance | None = None,
    shared: Sequence[SharedError] = (),
) -> NoiseEstimate:
    """Standard deviations of robot and camera from the residuals of the data themselves (`engine`, `sizes`).

    Linearised at 4DPA (or ``start``) and again at the estimate; the sizes are integrated over.

    Parameters
    ----------
    data : PosePairs or Motions
        One data set (no leading axes); on poses where there are any. With camera poses from corners
        (``camera_calibration``) or points (``camera_covariance``) the robot's noise is estimated given their joint
        covariance.
    prior : NoisePrior or None
        What a data sheet says; None: the medians of `sizes`.
    start : (4, 4) or None
        A consistent estimate of X.
    weights : (n,) or None
        0 or 1; 0 leaves a pose out.
    camera : CameraNoise or None
        The covariance of the camera poses but for their pixel noise (`camera_noise`).
    robot : covariance or None
        Of the robot poses, where `camera` is given; None: estimated too.
    shared : sequence of SharedError
        Errors that all poses share, further unknowns with a prior; the noise that is returned contains them.

    Raises
    ------
    InputError
        Weights that do not fit, or that leave no degrees of freedom.
    DegenerateMotionError
        The data do not determine X (or W).
    NotConvergedError
        The sizes do not converge.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> estimate = estimate_noise(uq.simulate(n_poses=30, noise=noise, seed=1))
    >>> estimate["translation, robot and camera together"].status
    'estimated'
    """
    constraint = constraint_of(data, None)
    if constraint.first.ndim != 3:
        raise InputError(f"Expected one data set, got leading axes {constraint.first.shape[:-3]}.")
    n = constraint.n
    if weights is not None:
        weights = np.asarray(weights, dtype=float)
        if weights.shape != (n,) or not np.isin(weights, (0.0, 1.0)).all():
            raise InputError(f"Expected `weights` to be {n} numbers, 0 or 1, got shape {weights.shape}.")
    poses = data.poses
    if shared and poses is None:
        raise InputError(
            "Expected poses beside `shared`: the effect of an error on motions without poses is not known."
        )
    if camera is not None and (camera.n != n or poses is None):
        raise InputError(f"Expected `camera` noise of these {n} poses, got that of {camera.n}.")
    errors = () if poses is None else checked_errors(shared, poses)
    model = JointModel.beside(constraint, poses, prior, camera, robot, errors)
    if start is None:
        return noise_estimate_of(model.find(sound_start(data, constraint, None), weights))
    return noise_estimate_of(
        model.find(start_of(data, constraint, as_transforms(start, "start", stack=False)), weights)
    )


def estimate_robot_noise(
    data: PosePairs,
    camera: Covariance | CameraNoise,
    prior: Mapping[ErrorKey, Size] | None = None,
    *,
    start: Array | None = None,
) -> NoiseEstimate:
    """Estimate rotation and translation noise of the robot poses, given the covariance of the camera poses.

    Parameters
    ----------
    data : PosePairs
        n poses, no leading axes.
    camera : JointCovariance, array (6, 6), (n, 6, 6), or CameraNoise
        Covariance of the camera poses, taken as true; positive definite. Of a `CameraNoise` without ``pixel_sd`` the
        pixel noise is estimated as well.
    prior : NoisePrior or None
        What a data sheet says of the robot.
    start : (4, 4) or None
        A consistent estimate of X; None takes 4DPA.

    Raises
    ------
    InputError
        Data that are no poses, too few of them, a covariance that does not fit; a prior for the camera.
    SingularNoiseError
        A camera covariance that leaves a part of the residuals exact.
    DegenerateMotionError
        The data do not determine X and W.
    NotConvergedError
        The sizes do not converge.
    """
    camera = PoseNoise(camera=camera).camera
    constraint = constraint_of(data, None if isinstance(camera, CameraNoise) else PoseNoise(camera=camera))
    if not isinstance(constraint, OnPoses) or constraint.first.ndim != 3:
        raise InputError("Expected `data` to be one set of PosePairs, got motions or several sets.")
    model = JointModel.beside(constraint, data, prior, camera, None, ())
    return noise_estimate_of(model.find(start_of(data, constraint, start)))
