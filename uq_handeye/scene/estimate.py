"""Steps of `scene_poses`: start of the scene, its pictures by the robot, its poses, and what is checked."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array, inverse, inverse_jacobian, skew
from ..core.limits import MAX_FOCAL_SD_SHARE
from ..errors import InputError
from ..findings import Finding
from ..model.errors.joint_covariance import JointCovariance
from .adjust import Pull, Scene, adjust, joint_covariance, reduce
from .colmap import Matched, Model
from .lens import MODEL, Lens
from .poses import as_poses, similarity

# Fewest points of a picture, and fewest pictures of a scene.
MIN_POINTS, MIN_PICTURES_OF_SCENE = 8, 6
# Matches of two pictures that make a scene if these are from two places.
MANY_MATCHES = 100
# Share of stationary matches that is said, and that is an error where there is no scene.
MANY_STATIONARY = 0.5
# Lenses beyond these are none: |fx / fy - 1|, and |p1| or |p2|.
MAX_ASPECT, MAX_TANGENTIAL = 0.005, 0.006
# Observations beyond this many times the pixel noise are left out of the adjustment.
FAR_RESIDUAL = 12.0


@dataclass(frozen=True, eq=False)
class Placed:
    """A scene of some of the pictures, adjusted, with its pixel noise."""

    rows: NDArray[np.intp]
    scene: Scene
    noise: float
    colours: NDArray[np.uint8]

    @property
    def n(self) -> int:
        """Number of pictures."""
        return len(self.rows)


def adjusted(model: Model, pull: Pull | None = None) -> Placed:
    """Adjust a model, without its pictures of few points and observations far off."""
    scene, rows, colours = model.scene, model.rows, model.colours
    for _ in range(3):  # each may leave pictures with too few points
        few = scene.tracks.per_picture < MIN_POINTS
        if not few.any():
            break
        kept = np.flatnonzero(~few)
        if len(kept) < 3:
            break
        points = scene.tracks.of_pictures(kept)[1]
        scene = scene.of_pictures(kept)
        rows, colours = rows[kept], colours[points]
        if pull is not None:
            pull = pull.of_pictures(kept)
    if not scene.tracks.m or scene.tracks.n < 3:
        raise InputError("The pictures do not make one scene: too few points are seen in several of them.")
    scene, noise = adjust(scene, pull)
    far = np.linalg.norm(scene.residuals(), axis=-1) > FAR_RESIDUAL * noise
    if far.any():
        t = scene.tracks
        kept = ~far
        kept &= (np.bincount(t.point[kept], minlength=t.m) > 1)[t.point]
        tracks, points = t.where(kept)
        if (tracks.per_picture >= MIN_POINTS).all():
            scene, colours = replace(scene, tracks=tracks, points=scene.points[points]), colours[points]
            scene, noise = adjust(scene, pull)
    return Placed(rows, scene, noise, colours)


def pull_of_robot(robot: Array, X: Array, covariance: JointCovariance, weights: Array, eye_to_hand: bool) -> Pull:
    """Knowledge of the camera poses of a scene, in the base frame, from robot poses and X; X is integrated over.

    ``robot`` (n, 4, 4) base_T_gripper, their ``covariance``, of which the robust ``weights`` (n,) divide what each pose
    has by itself. With ``T = G X`` (G inverted for eye-to-hand) and ``C = T^-1``:

        zeta_i = E_i (D_i xi_i + M_i xi_X),   E = [[-R^T, 0], [-R^T [t]x, -R^T]],   D = [[1, 0], [-[R_G t_X]x, 1]]

    With A = blkdiag(E_i D_i S_i D_i^T E_i^T)^-1 of the own parts S_i and K the errors E_i D_i F_i that all poses share,
    such as the accuracy of the arm, the information is ``A - A K (1 + K^T A K)^-1 K^T A``.
    """
    n = len(robot)
    G = inverse(robot) if eye_to_hand else robot
    T = G @ X
    R_G, E = G[:, :3, :3], inverse_jacobian(T)
    D, by_X = np.tile(np.eye(6), (n, 1, 1)), np.zeros((n, 6, 6))
    D[:, 3:, :3] = -skew((R_G @ X[:3, 3:])[..., 0])
    by_X[:, :3, :3] = by_X[:, 3:, 3:] = R_G
    to_pose = E @ D @ (inverse_jacobian(robot) if eye_to_hand else np.eye(6))
    # an exact robot is as exact as 1e-6 rad and m; a pose that was rejected has a small weight
    S = (covariance.own + 1e-6**2 * np.eye(6)) / np.maximum(weights, 1e-8)[:, None, None]
    each = np.linalg.inv(to_pose @ S @ to_pose.mT)
    M, information = (E @ by_X).reshape(6 * n, 6), np.zeros((6 * n, 6 * n))
    information.reshape(n, 6, n, 6)[np.arange(n), :, np.arange(n), :] = each
    K = (to_pose @ covariance.shared).reshape(6 * n, -1)
    AK = information @ K
    information -= AK @ np.linalg.solve(np.eye(K.shape[1]) + K.T @ AK, AK.T)
    gain = information @ M
    information -= gain @ np.linalg.pinv(M.T @ gain, 1e-13, hermitian=True) @ gain.T
    return Pull(inverse(T), 0.5 * (information + information.T))


def lens_sd(placed: Placed, pull: Pull | None = None) -> Array:
    """Standard deviations (f,) of the free intrinsics, by the pictures and what else is known of the poses."""
    at = reduce(placed.scene, placed.noise)
    gauge = similarity(placed.scene.poses)
    return np.sqrt(np.maximum(np.diag(joint_covariance(at, pull, gauge))[6 * at.n :], 0.0))


def centred(placed: Placed) -> Placed:
    """Return the scene with its origin at the median of its points."""
    T = np.eye(4)
    T[:3, 3] = -np.median(placed.scene.points, axis=0)
    return replace(placed, scene=placed.scene.moved(T))


def measured_poses(placed: Placed) -> tuple[Array, JointCovariance]:
    """Camera poses of the pictures with their joint covariance, for `calibrate`."""
    return as_poses(reduce(placed.scene, placed.noise), placed.scene.poses)


def no_scene(seen: Matched, setup: str) -> InputError:
    """Return the error of pictures that make no scene."""
    share = seen.stationary_share()
    if share > MANY_STATIONARY and setup == "eye-in-hand":
        return InputError(str(Finding("scene.stationary", "failure", {"share": share})))
    most = max(seen.verified.values(), default=0)
    if setup == "eye-to-hand":
        return InputError(
            f"The pictures do not make one scene: {most} matches between the best two of {len(seen.names)} pictures "
            "move with the hand. Let the hand carry a rigid textured object that fills 10 % of the picture or more, "
            "rotate it about two axes; or use a board."
        )
    if most >= MANY_MATCHES:
        return InputError(
            f"The pictures match ({most} matches between the best two of {len(seen.names)}), but do not make one "
            "scene: they may be from one place. Move the camera by a third of the distance to the scene, all around it."
        )
    return InputError(
        f"The pictures do not make one scene: {most} matches between the best two of {len(seen.names)} pictures. Put "
        "textured objects (a newspaper, boxes) into view, light it, avoid blur; or use a board."
    )


def lens_findings(lens: Lens, sd: Array) -> list[Finding]:
    """Findings of a lens with the standard deviations (f,) of its free intrinsics."""
    found = []
    spread = np.zeros(len(MODEL.names))
    spread[lens.free] = sd
    fx, fy, p1, p2 = lens.values[[0, 1, 6, 7]]
    if spread[0] > MAX_FOCAL_SD_SHARE * fx:
        found.append(Finding("scene.focal_open", "failure", {"focal": fx, "sd": spread[0]}))
    ratio = fx / fy
    odd = abs(ratio - 1.0) > MAX_ASPECT and lens.square
    odd |= max(abs(p1), abs(p2)) > MAX_TANGENTIAL and bool(lens.free[6:8].any())
    if odd:
        found.append(Finding("scene.lens", "failure", {"ratio": ratio, "p1": p1, "p2": p2}))
    return found
