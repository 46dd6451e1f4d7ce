r"""One camera of a rig with one target, as the result of one camera: the marginal of the joint posterior.

What uses a result of one camera (predictions, touches, differences, simulation, the posterior by sampling, exports)
takes that of a rig by this. With s the errors of the rig's posterior and M the linear map to those of one camera,

    s_1 = (xi_X, xi_W, e) = M s,      P_1 = M P M^T

X and W are stated in the gripper and the base of the arm that carries camera or target: of an arm whose base is not the
world, ``B^-1 T`` has the error of `relative_pose`. The errors e of arm, camera and target are in their units (rad, m,
relative), where the rig has those of variance 1; the size that all targets share is added to that of the target. Errors
of other cameras and targets are integrated out. The noise is that of the rig at the views that count.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from ..core.files.source import versions
from ..core.geometry.se3 import Array
from ..errors import InputError
from ..fit.graph.graph import Graph
from ..fit.graph.noise import RigNoise
from ..fit.graph.open_directions import OpenDirections
from ..fit.graph.posterior import Posterior
from ..fit.graph.sizes import NUMBERS
from ..model.errors.cholesky import factor
from ..model.errors.error_estimate import ErrorEstimate, resolved_share
from ..model.errors.joint_covariance import JointCovariance
from ..model.errors.key import ErrorKey, Kind, Owner
from ..model.errors.keys import LENS, TARGET_SCALE
from ..model.errors.models import PoseNoise
from ..model.errors.sizes import Size
from ..model.errors.term import ErrorTerm
from ..model.kinematics.errors import GROUPS
from ..model.poses.motions import relative_motions
from ..model.poses.pose_data import sha256_of
from ..model.poses.residuals import residuals, summarise
from ..model.rig.description import WORLD, Rig
from ..model.rig.selection import some_of
from ..model.rig.single import single_of
from ..model.shared_errors.view import LENS_SHARES, view_block
from .analysis import FittedKinematics
from .parts import Provenance
from .prediction.noise_of_views import new_noise, parts_of, posterior_of
from .result import Calibration
from .rig_poses import RigPoses, relative_pose

# Errors of an arm that its kinematics hold with their sizes.
_OF_ARM = (*GROUPS, Kind.JOINT_NOISE)
# Noise of each pose that a result of one camera has with its size.
_FRESH = (Kind.ROTATION, Kind.TRANSLATION, Kind.BY_VIEW)


def of_camera(result: RigPoses, camera: str, target: str | None = None) -> Calibration:
    """Return one camera and one target of a rig as a `Calibration`, with their marginal posterior.

    Parameters
    ----------
    result : RigCalibration
    camera : str
    target : str or None
        None: the one that the camera sees most often.

    Raises
    ------
    InputError
        Names that the rig does not have; a camera and a target that no arm moves against each other, or that are on two
        arms: their X belongs to two robot poses.

    Examples
    --------
    >>> import numpy as np, uq_handeye as uq
    >>> noise = dict.fromkeys(("arm", "left", "right"), ("0.5mrad", "0.3mm"))
    >>> cameras, targets = {"left": "arm", "right": "arm"}, {"board": "world"}
    >>> rig, _ = uq.simulate_rig(cameras, targets, n_poses=15, noise=noise, seed=1)
    >>> result = uq.calibrate(rig, noise=noise)
    >>> left = uq.of_camera(result, "left")
    >>> left.frame, bool(np.allclose(left.covariance, result.cameras["left"].covariance))
    ('gripper_T_camera', True)
    """
    target = _target(result.rig, camera, target)
    arm, setup = _carrier(result.rig, camera, target)
    pair = _pair(result, arm, camera, target)
    poses = replace(single_of(pair).poses, camera_covariance=None)
    noise = new_noise(result, pair, Graph.of(pair))
    by_poses, (X, W) = _by_poses(result, arm, camera, target)
    parts = parts_of(result, pair, Graph.of(pair))
    errors = _errors(result, (arm, camera, target), parts)
    N = len(posterior_of(result).covariance)
    M = np.zeros((12 + len(errors), N))
    M[:12, : by_poses.shape[1]] = by_poses
    for k, of in enumerate(errors.values()):
        for place, unit in of.items():
            M[12 + k, place] = unit
    whole = posterior_of(result)
    S = M @ whole.covariance @ M.T
    keys, estimate = tuple(errors), M[12:, N - len(whole.keys) :] @ whole.estimate
    posterior = Posterior(
        keys, estimate, 0.5 * (S + S.T), noise=_fresh(result, (arm, camera), pair, noise),
        bound=_bound(result, arm, camera),
    )  # fmt: skip
    motions = relative_motions(poses, "consecutive")
    opened = _open(result, by_poses)
    options = {"method": result.method, "rig": [arm, camera, target]}
    shared = _estimates(posterior, errors)
    return Calibration(
        X,
        covariance=S[:6, :6],
        W=W,
        covariance_W=S[6:12, 6:12],
        opened=opened,
        findings=result.findings,
        setup=setup,
        n_poses=poses.n,
        n_pairs=len(motions),
        data=poses,
        provenance=Provenance(sha256_of(poses.robot, poses.camera), options, dict(versions())),
        method=result.method,
        scale=None,
        kind="poses",
        reference=result.reference,
        residuals=summarise(*residuals(motions.A, motions.B, X)),
        noise=_noise(noise, keys, M[12:, N - len(whole.keys) :]),
        shared_at_sizes=shared,
        kinematics=_kinematics(result, arm, pair, posterior, parts),
        joint_posterior=None if opened is not None else posterior,
    )


def _target(rig: Rig, camera: str, target: str | None) -> str:
    """Return the target, by default the one that is seen most; raises `InputError` for names that the rig lacks."""
    if camera not in rig.cameras:
        raise InputError(f"Expected a camera out of {', '.join(rig.cameras)}, got {camera!r}.")
    seen: Counter[str] = Counter()
    for view in rig.views:
        if view.camera == camera:
            seen[view.target] += len(view.poses)
    if target is not None and target not in seen:
        raise InputError(f"Expected a target that {camera} sees, out of {', '.join(seen)}, got {target!r}.")
    return target or seen.most_common(1)[0][0]


def _carrier(rig: Rig, camera: str, target: str) -> tuple[str, str]:
    """Return the arm that moves camera and target against each other, and the setup."""
    places = rig.cameras[camera], rig.targets[target]
    if places[0] == places[1]:
        raise InputError(f"{camera} and {target} are both on {places[0]!r}: no arm moves them against each other.")
    if WORLD not in places:
        raise InputError(
            f"{camera} is on {places[0]!r} and {target} on {places[1]!r}: their X belongs to two robot poses. Use the "
            "result of the whole rig, or a target of the world."
        )
    return (places[0], "eye-in-hand") if places[1] == WORLD else (places[1], "eye-to-hand")


def _pair(result: RigPoses, arm: str, camera: str, target: str) -> Rig:
    """Return the rig of one arm, one camera and one target, of the views that count."""
    rig, views, k = result.rig, [], 0
    out = {moment for name, moment in result.rejected_poses if name == arm}
    for view in rig.views:
        at, weights = view.at or (), result.weights[k : k + len(view.poses)]
        k += len(view.poses)
        if (view.camera, view.target) != (camera, target):
            continue
        kept = [row for row, moment in enumerate(at) if weights[row] > 0 and moment not in out]
        if kept:
            views.append(some_of(view, kept))
    if sum(len(view.poses) for view in views) < 3:
        raise InputError(f"Fewer than 3 views of {target} by {camera} agree with the rig.")
    return Rig({arm: rig.arms[arm]}, {camera: rig.cameras[camera]}, {target: rig.targets[target]}, tuple(views))


def _by_poses(result: RigPoses, arm: str, camera: str, target: str) -> tuple[Array, tuple[Array, Array]]:
    """Return the errors of X and W by those of all poses of the rig, (12, 6m), and X and W in the frames of the arm."""
    names, by, found = result.names, np.zeros((12, 6 * len(result.names))), []
    for row, name in ((0, camera), (6, target)):
        k = names.index(name)
        of = slice(6 * k, 6 * k + 6)
        if result.rig.place(name) == WORLD and arm in names:
            base = names.index(arm)
            pose, by_base, by_own = relative_pose(result.poses[base], result.poses[k])
            by[row : row + 6, 6 * base : 6 * base + 6], by[row : row + 6, of] = by_base, by_own
        else:
            pose, by[row : row + 6, of] = result.poses[k], np.eye(6)
        found.append(pose)
    return by, (found[0], found[1])


def _errors(
    result: RigPoses, names: tuple[str, str, str], parts: tuple[ErrorTerm, ...]
) -> dict[ErrorKey, dict[int, float]]:
    """Return the errors of one camera in their units, by the places in the posterior of the rig's errors."""
    posterior = posterior_of(result)
    p, found = posterior.p, dict[ErrorKey, dict[int, float]]()
    units = {key: part.size.median for part in parts for key in part.keys}
    for k, key in enumerate(posterior.keys):
        if key.name not in names and key.owner != Owner.TARGETS:
            continue
        one = TARGET_SCALE if key.owner == Owner.TARGETS else key.of("")
        unit = units.get(key, 1.0)
        if one.error == LENS:
            unit *= float(LENS_SHARES[NUMBERS[LENS].index(one)])
        found.setdefault(one, {})[p + k] = unit
    return found


def _noise(noise: RigNoise, keys: tuple[ErrorKey, ...], units: Array) -> PoseNoise:
    """Return the noise of the views: that of each pose, and a column of one standard deviation of each shared error.

    ``units`` (q, m): the errors by those of variance 1.
    """
    sides = {}
    for side, own, K in (("robot", noise.robot, noise.K_robot), ("camera", noise.camera, noise.K_camera)):
        F = _joined(K, units)
        some = np.flatnonzero(np.abs(F).max(axis=(0, 1), initial=0.0) > 0)
        sides[side] = JointCovariance(own, F[..., some], tuple(keys[k] for k in some.tolist()))
    return PoseNoise(sides["robot"], sides["camera"])


def _joined(K: Array, units: Array) -> Array:
    """(n, 6, q) columns of one standard deviation of each error, of one or two numbers of variance 1 with one shape."""
    found = np.zeros((*K.shape[:2], len(units)))
    for k, row in enumerate(units):
        places = np.flatnonzero(row)
        found[..., k] = np.sqrt((K[..., places] ** 2).sum(axis=-1)) * np.sign(K[..., places[0]])
    return found


def _fresh(result: RigPoses, names: tuple[str, str], pair: Rig, noise: RigNoise) -> tuple[ErrorTerm, ...]:
    """Return the noises of new poses of the arm and the camera."""
    lines = {ErrorKey.from_dict(line["key"]): float(line["size"]) for line in result.components}
    found = []
    C = np.concatenate([view.poses for view in pair.views])
    own = {Owner.ROBOT: noise.robot.mean(axis=0), Owner.CAMERA: noise.camera.mean(axis=0)}
    by_view = view_block(C)
    usual = factor((by_view @ by_view.mT).mean(axis=0))
    blocks = {Kind.ROTATION: np.eye(6)[:, :3], Kind.TRANSLATION: np.eye(6)[:, 3:], Kind.BY_VIEW: usual}
    for owner, name in zip((Owner.ROBOT, Owner.CAMERA), names, strict=True):
        sizes = {kind: lines.get(ErrorKey(owner, kind, name=name)) for kind in _FRESH}
        if sizes[Kind.TRANSLATION] is None or pair.arms[names[0]].kinematics is not None:
            found.append(ErrorTerm.given(owner.value, own[owner]))
            continue
        for kind, size in sizes.items():
            if size is not None:
                found.append(ErrorTerm(ErrorKey(owner, kind), owner.value, Size(size), block=blocks[kind]))
    return tuple(found)


def _bound(result: RigPoses, arm: str, camera: str) -> tuple[Array, Array]:
    """Return the robot and camera poses that errors of poses were bound to."""
    graph = Graph.of(result.rig)
    of_arm = list(result.rig.arms).index(arm)
    edges = np.flatnonzero(graph.names.index(camera) == graph.X)
    side = np.where(graph.side[0] < graph.P, graph.side[0], graph.side[1])[edges]
    kept = edges[(side < graph.P) & (graph.arm[np.minimum(side, graph.P - 1)] == of_arm)]
    side = np.where(graph.side[0] < graph.P, graph.side[0], graph.side[1])[kept]
    return graph.robot[side], graph.C[kept]


def _open(result: RigPoses, by_poses: Array) -> OpenDirections | None:
    """Return the directions of X and W that stay open."""
    if not len(result.open):
        return None
    units = np.tile(np.repeat([result.lever, 1.0], 3), 2)
    moved = (result.open @ by_poses.T) * units
    _, s, V = np.linalg.svd(moved, full_matrices=False)
    basis = V[s > 1e-6] / units
    return OpenDirections(basis, result.lever) if len(basis) else None


def _estimates(posterior: Posterior, errors: dict[ErrorKey, dict[int, float]]) -> tuple[ErrorEstimate, ...]:
    sd = np.sqrt(np.maximum(np.diag(posterior.covariance)[12:], 0.0))
    found = []
    for key, e, s in zip(errors, posterior.estimate.tolist(), sd.tolist(), strict=True):
        size = float(np.sqrt(sum(unit**2 for unit in errors[key].values())))
        side = "robot" if key.owner == Owner.ROBOT else "camera"
        found.append(
            ErrorEstimate(key, side, "", size, size, size, count=1, resolved=resolved_share(s, size), estimate=e, sd=s)
        )
    return tuple(found)


def _kinematics(
    result: RigPoses, arm: str, pair: Rig, posterior: Posterior, parts: tuple[ErrorTerm, ...]
) -> FittedKinematics | None:
    of = pair.arms[arm]
    if of.kinematics is None or of.joints is None:
        return None
    place = {moment: k for k, moment in enumerate(of.names)}
    rows = [place[moment] for view in pair.views for moment in view.at or ()]
    sd = {part.key.kind.value: part.size.median for part in parts if part.side == "robot" and part.key.kind in _OF_ARM}
    return FittedKinematics.of(of.kinematics, of.joints[rows], "estimate", "workspace", sd, (0.0, 0.0), posterior)
