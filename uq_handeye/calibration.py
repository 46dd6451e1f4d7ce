"""calibrate(): from poses or motions and their noise to X with its uncertainty, in one documented object."""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from . import conventions
from .all_pairs import AllPairs
from .errors import DegenerateMotionError, InputError, InputWarning, NotConvergedError
from .estimators import solve
from .estimators.method import require_converged
from .estimators.registry import METHODS, ROBOT_WORLD_METHODS, find
from .io.atomic import write_atomically
from .motions import Motions, relative_motions, spread_pairs
from .noise import Noise, PairNoise, PoseNoise, checked_covariance, require_count
from .noise_transport import covariance_of_poses, noise_of_pairs
from .octonion_covariance import PAPER_SCALE
from .plausibility import check_fit, check_motions, check_poses, check_rotations, require_signal
from .poses import SETUPS, TARGETS, PosePairs
from .procrustes import octonion
from .propagation import pose_sensitivities, propagate
from .residuals import Residuals, residuals, rotation_angles, summarise
from .robot_world import mean_target, target_by_X, target_sensitivities
from .se3 import Array, as_transforms, inverse, inverse_jacobian
from .sensitivity import pose_from_octonion_jacobian

CONVENTION = (
    "xi = (theta, tau): R = exp([theta]x) R_hat, t = t_hat + tau; rotation first, left rotation, additive "
    "translation; rad and m; in the parent frame of X"
)
# A first-order covariance of a rotation means nothing beyond this standard deviation.
UNDETERMINED = np.radians(20.0)

# All pairs of many poses are solved without forming them; residuals and checks then look at about so many.
DIAGNOSED_PAIRS = 200_000

# Beyond this angle of X (degrees) the errors of Tsai's Rodrigues vector grow by a factor of ten and more.
NEAR_HALF_TURN_OF_X = 170.0

_FORMAT = "uq-handeye calibration 1"


@dataclass(frozen=True, eq=False)
class Calibration:
    """X of AX = XB and what is known about it.

    Model: ``X = (R, t)`` with the error ``xi = (theta, tau)``, ``R = exp([theta]x) R_hat``,
    ``t = t_hat + tau``, in rad and m, in the parent frame of X (gripper for eye-in-hand, base for eye-to-hand);
    ``covariance`` is that of xi, to first order.
    """

    X: Array  # (4, 4)
    covariance: Array | None  # (6, 6); None: not determined, no noise was given
    method: str
    scale: float | None
    kind: str | None  # how the covariance was propagated: "pairs", "poses" or "literal"
    setup: str | None  # None for motions that came without poses
    n_poses: int | None
    n_pairs: int
    noise: Noise | None
    residuals: Residuals
    warnings: tuple[str, ...] = ()
    W: Array | None = None  # (4, 4), the mean of G X C: base_T_target (gripper_T_target for eye-to-hand)
    covariance_W: Array | None = None  # (6, 6), as `covariance`, in the parent frame of W; needs noise on the poses
    iterations: int = 0  # 0: closed form

    @property
    def frame(self) -> str:
        """The frames of X, e.g. ``gripper_T_camera``."""
        return "X" if self.setup is None else SETUPS[self.setup]

    @property
    def frame_W(self) -> str:
        """The frames of W, e.g. ``base_T_target``."""
        return "W" if self.setup is None else TARGETS[self.setup]

    @property
    def std(self) -> Array | None:
        """Standard deviations (6,) of (theta, tau), rad and m."""
        return None if self.covariance is None else np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def std_W(self) -> Array | None:
        """Standard deviations (6,) of (theta, tau) of W, rad and m."""
        return None if self.covariance_W is None else np.asarray(np.sqrt(np.diag(self.covariance_W)))

    @property
    def correlation(self) -> Array | None:
        """Correlation matrix (6, 6) of (theta, tau); 0 beside a variance of 0."""
        if self.covariance is None or self.std is None:
            return None
        unit = np.where(self.std > 0, self.std, 1.0)
        correlation: Array = self.covariance / np.outer(unit, unit)
        np.fill_diagonal(correlation, 1.0)
        return correlation

    @property
    def inverse(self) -> Array:
        """``inv(X)`` (4, 4), e.g. ``camera_T_gripper``."""
        return inverse(self.X)

    @property
    def covariance_inverse(self) -> Array | None:
        """Covariance (6, 6) of ``inv(X)`` in the same convention, in its own parent frame."""
        if self.covariance is None:
            return None
        J = inverse_jacobian(self.X)
        return np.asarray(J @ self.covariance @ J.T)

    @property
    def sigma_scale(self) -> float:
        """The factor d at which `sigma` is given: that of the estimate, or 1e4 where it was the limit."""
        return PAPER_SCALE if self.scale is None else self.scale

    @property
    def sigma(self) -> Array:
        """The unit octonion (8,) of X on SO(4) (18), at `sigma_scale`."""
        return octonion(self.X, self.sigma_scale)

    @property
    def covariance_sigma(self) -> Array | None:
        """Covariance (8, 8) of `sigma` (48), of rank 6: the unit lengths of q_L and q_R are exact."""
        if self.covariance is None:
            return None
        sigma = self.sigma
        # sigma moves in the six directions orthogonal to (q_L, 0) and (0, q_R); there d xi / d sigma is regular.
        normals = np.zeros((8, 2))
        normals[:4, 0], normals[4:, 1] = sigma[:4], sigma[4:]
        tangent = np.linalg.qr(normals, mode="complete")[0][:, 2:]
        J = tangent @ np.linalg.inv(pose_from_octonion_jacobian(sigma, self.sigma_scale) @ tangent)
        return np.asarray(J @ self.covariance @ J.T)

    def covariance_in(self, convention: str) -> Array:
        """The covariance in the convention of another library; see `uq_handeye.conventions`."""
        if self.covariance is None:
            raise InputError("The covariance is not determined: no noise was given to calibrate().")
        return conventions.to_convention(self.covariance, self.X, convention)

    @property
    def quaternion(self) -> Array:
        """Unit quaternion (x, y, z, w) of X, w >= 0."""
        return np.asarray(Rotation.from_matrix(self.X[:3, :3]).as_quat(canonical=True))

    @property
    def weakest_rotation(self) -> tuple[Array, float] | None:
        """Axis (3,) about which the rotation of X is least certain, and its standard deviation in rad."""
        return None if self.covariance is None else _weakest(self.covariance[:3, :3])

    @property
    def weakest_translation(self) -> tuple[Array, float] | None:
        """Direction (3,) along which the translation of X is least certain, and its standard deviation in m."""
        return None if self.covariance is None else _weakest(self.covariance[3:, 3:])

    def __repr__(self) -> str:
        return f"Calibration({self.frame}, {self.method}, {self.n_pairs} pairs)"

    def summary(self, threshold: float = 0.5) -> str:
        """The result as text; correlations at or above ``threshold`` are listed."""
        from .report.text import summary

        return summary(self, threshold) + "".join(f"\nWarning: {text}\n" for text in self.warnings)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, lists and text, with units and convention; see `from_dict`."""
        std, correlation, J = self.std, self.correlation, self.covariance_inverse
        return {
            "format": _FORMAT,
            "convention": CONVENTION,
            "units": {"rotation": "rad", "translation": "m"},
            "method": self.method,
            "scale": self.scale,
            "kind": self.kind,
            "setup": self.setup,
            "frame": self.frame,
            "X": self.X.tolist(),
            "covariance": _plain(self.covariance),
            "std": _plain(std),
            "correlation": _plain(correlation),
            "quaternion_xyzw": self.quaternion.tolist(),
            "inverse": self.inverse.tolist(),
            "covariance_inverse": _plain(J),
            "n_poses": self.n_poses,
            "n_pairs": self.n_pairs,
            "noise": noise_to_dict(self.noise),
            "frame_W": self.frame_W,
            "W": _plain(self.W),
            "covariance_W": _plain(self.covariance_W),
            "std_W": _plain(self.std_W),
            "iterations": self.iterations,
            "residuals": self.residuals._asdict(),
            "warnings": list(self.warnings),
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Calibration:
        """The inverse of `to_dict`; raises `InputError` on anything else."""
        if not isinstance(data, dict) or data.get("format") != _FORMAT:
            raise InputError(f"Expected a calibration written by to_json() (format {_FORMAT!r}).")
        try:
            W = data["W"]
            result = cls(
                X=as_transforms(data["X"], "X", stack=False),
                covariance=_covariance_from(data, "covariance"),
                W=None if W is None else as_transforms(W, "W", stack=False),
                covariance_W=_covariance_from(data, "covariance_W"),
                iterations=_expected(data["iterations"], int),
                method=_expected(data["method"], str),
                scale=_expected(data["scale"], float, None),
                kind=_expected(data["kind"], str, None),
                setup=_expected(data["setup"], str, None),
                n_poses=_expected(data["n_poses"], int, None),
                n_pairs=_expected(data["n_pairs"], int),
                noise=_noise_from_dict(data["noise"]),
                residuals=Residuals(**data["residuals"]),
                warnings=tuple(_expected(text, str) for text in _expected(data["warnings"], list)),
            )
            for name, shape in (("X", (4, 4)), ("W", (4, 4)), ("covariance", (6, 6)), ("covariance_W", (6, 6))):
                if (value := getattr(result, name)) is not None and value.shape != shape:
                    raise ValueError(f"{name} has the shape {value.shape}")
            if result.setup not in (None, *SETUPS):
                raise ValueError(f"unknown setup {result.setup!r}")
        except KeyError as error:
            raise InputError(f"The calibration is damaged: {error} is missing.") from error
        except (TypeError, ValueError, AttributeError) as error:
            raise InputError(f"The calibration is damaged: {str(error).rstrip('.')}.") from error
        return result

    def to_json(self, path: str | Path | None = None) -> str:
        """JSON text, also written to ``path`` (whole or not at all); numbers survive without loss."""
        text = json.dumps(self.to_dict(), indent=2, allow_nan=False) + "\n"
        if path is not None:
            write_atomically(path, text)
        return text

    @classmethod
    def from_json(cls, path: str | Path) -> Calibration:
        """Read what `to_json` wrote."""
        try:
            data = json.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, TypeError) as error:
            raise InputError(f"Cannot read {path}: {getattr(error, 'strerror', None) or error}.") from error
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path} is not JSON: {error}.") from error
        try:
            return cls.from_dict(data)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error


def _covariance_from(data: dict[str, Any], name: str) -> Array | None:
    return None if data[name] is None else checked_covariance(data[name], name, joint=False)


def _expected(value: Any, *types: type | None) -> Any:
    """``value`` if it is of one of the types; None stands for None."""
    known = tuple(kind for kind in types if kind is not None)
    if (value is None and None in types) or (isinstance(value, known) and not isinstance(value, bool)):
        return value
    raise TypeError(f"got {value!r:.40}")


def require_noise_fits(noise: Noise | None, motions: Motions) -> None:
    if isinstance(noise, PairNoise):
        require_count(noise.A, motions.N, "A", "motions")
        require_count(noise.B, motions.N, "B", "motions")
    elif isinstance(noise, PoseNoise):
        if motions.poses is None:
            raise InputError("PoseNoise needs poses; for motions that come without poses use PairNoise.")
        require_count(noise.robot, motions.poses.n, "robot", "poses")
        require_count(noise.camera, motions.poses.n, "camera", "poses")
    elif noise is not None:
        raise InputError(f"Expected `noise` to be PoseNoise, PairNoise or None, got {type(noise).__name__}.")


def _weakest(covariance: Array) -> tuple[Array, float]:
    values, vectors = np.linalg.eigh(covariance)
    axis = vectors[:, -1]
    axis = axis if axis[np.argmax(np.abs(axis))] > 0 else -axis
    return axis, float(np.sqrt(max(values[-1], 0.0)))


def _plain(array: Array | None) -> Any:
    return None if array is None else array.tolist()


def noise_to_dict(noise: Noise | None) -> dict[str, Any] | None:
    if noise is None:
        return None
    return {"type": type(noise).__name__} | {field.name: _plain(getattr(noise, field.name)) for field in fields(noise)}


def _noise_from_dict(data: dict[str, Any] | None) -> Noise | None:
    if data is None:
        return None
    if data["type"] == "PairNoise":
        return PairNoise(data["A"], data["B"])
    return PoseNoise(data["robot"], data["camera"])


def calibrate(
    data: PosePairs | Motions,
    *,
    noise: Noise | None = None,
    method: str = "4dpa",
    pairs: str | ArrayLike = "all",
    scale: float | None = None,
    kind: str | None = None,
) -> Calibration:
    """X with its covariance, residuals and warnings.

    Parameters
    ----------
    data : PosePairs or Motions
    noise : PoseNoise, PairNoise or None
        Noise of the poses or of the motions. None gives X without covariance.
    method : str
        A name in `METHODS` or, for poses, in `ROBOT_WORLD_METHODS`.
    pairs : "all", "consecutive", "disjoint" or (N, 2) integers
        Pairs to make of the poses (`relative_motions`); Motions come with theirs. The methods of
        `ROBOT_WORLD_METHODS` need none; residuals are still those of the pairs.
    scale : float or None
        Scaling factor d of 4DPA; None is its limit (`solve`).
    kind : str or None
        How noise is propagated (`propagate`).

    Where poses are given, W is the mean of ``G X C`` (`robot_world`), or the estimate of a method that has its own,
    with its covariance if the noise is on the poses. A method that weights by the noise (``nguyen``) takes the
    covariance of each pair that PoseNoise makes.

    Raises
    ------
    InputError
        Input that cannot be used.
    DegenerateMotionError
        The motions do not determine X; or their rotations do not stand out of their noise (`require_signal` in
        `plausibility`); or with the noise given they leave its rotation open by more than 20 degrees, where a
        first-order covariance means nothing: only then ``partial`` holds the `Calibration`.
    NotConvergedError
        An iterative method did not converge.

    Warns
    -----
    InputWarning
        Input that looks wrong; the texts are also in ``warnings`` of the result.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> result = uq.calibrate(uq.simulate(n_poses=30, noise=noise, seed=1), noise=noise)
    >>> (result.std[3:] * 1e3).round(2)  # mm
    array([0.44, 0.43, 0.32])
    """
    poses = data if isinstance(data, PosePairs) else None
    everything: AllPairs | None = None
    if isinstance(data, PosePairs):
        if data.n < 3:
            raise InputError(f"Expected at least 3 poses, which make 2 motions, got {data.n}.")
        if data.robot.ndim != 3:
            raise InputError("Expected one data set; for a batch call solve() and propagate().")
        if isinstance(pairs, str) and pairs == "all":
            direct = scale is None and kind in (None, "poses") and not isinstance(noise, PairNoise)
            if method == "4dpa" and direct and (of_all := AllPairs(data)).precise:
                everything = of_all
            if everything or (isinstance(method, str) and method in ROBOT_WORLD_METHODS):
                # the pairs serve residuals and checks alone
                pairs = spread_pairs(data.n, DIAGNOSED_PAIRS)
        motions = relative_motions(data, pairs)
    elif isinstance(data, Motions):
        motions, poses = data, data.poses
        if motions.A.ndim != 3:
            raise InputError("Expected one data set; for a batch call solve() and propagate().")
    else:
        raise InputError(f"Expected `data` to be PosePairs or Motions, got {type(data).__name__}.")
    require_noise_fits(noise, motions)
    texts = [] if poses is None else check_poses(poses)
    if motions.N >= 2:
        texts += check_rotations(motions, noise, method)
    pose_noise = noise if isinstance(noise, PoseNoise) and kind in (None, "poses") else None
    covariance = covariance_W = None
    try:
        fit = _fit(motions, noise, method, scale, everything, sensitive=pose_noise is not None)
        X = fit.X
        angle, distance = residuals(motions.A, motions.B, X)
        require_signal(motions, noise, angle)
        if pose_noise is not None:
            covariance, covariance_W = (covariance_of_poses(D, pose_noise) for D in (fit.by_error, fit.by_error_W))
            if poses is not None and method in METHODS and not METHODS[method].smooth:
                # what is uncorrelated with the errors of the poses reaches W through X alone
                rest = propagate(motions, pose_noise, X=X, method=method) - covariance
                J = target_by_X(poses, X)
                covariance, covariance_W = covariance + rest, covariance_W + J @ rest @ J.T
        elif noise is not None:
            covariance = propagate(motions, noise=noise, X=X, method=method, scale=scale, kind=kind)
    except (InputError, NotConvergedError):
        for text in texts:  # what looks wrong may well be the reason
            warnings.warn(text, InputWarning, stacklevel=2)
        raise
    if poses is None:
        texts += check_motions(motions, noise, covariance, angle, distance, X)
    else:
        texts += check_fit(poses, X, noise if isinstance(noise, PoseNoise) else None, covariance)
    turn = float(np.degrees(rotation_angles(X[:3, :3])))
    if method == "tsai" and turn > NEAR_HALF_TURN_OF_X:
        texts.append(
            f"X turns by {turn:.1f} degrees. The Rodrigues vector that Tsai's method solves for grows without bound at "
            "180 degrees, and so do its errors: use another method."
        )
    if noise is not None:
        kind = kind or ("poses" if isinstance(noise, PoseNoise) else "pairs")
    elif kind is not None:
        raise InputError(f"kind={kind!r} means nothing without `noise`.")
    result = Calibration(
        X=X,
        covariance=covariance,
        method=method,
        scale=scale,
        kind=kind,
        setup=None if poses is None else poses.setup,
        n_poses=None if poses is None else poses.n,
        n_pairs=everything.n_pairs if everything else motions.N,
        noise=noise,
        residuals=summarise(angle, distance),
        warnings=tuple(texts),
        W=fit.W,
        covariance_W=covariance_W,
        iterations=fit.iterations,
    )
    for text in texts:
        warnings.warn(text, InputWarning, stacklevel=2)
    if (weakest := result.weakest_rotation) is not None and weakest[1] > UNDETERMINED:
        axis, deviation = weakest
        directions = np.zeros((1, 6))
        directions[0, :3] = axis
        raise DegenerateMotionError(
            f"With this noise the motions do not determine X by method {method!r}: its rotation about "
            f"({', '.join(f'{x:.3f}' for x in axis)}) in the frame of `A` has a first-order standard deviation of "
            f"{np.degrees(deviation):.0f} degrees. {_advice(method, motions)}",
            directions,
            partial=result,
        )
    return result


def _advice(method: str, motions: Motions) -> str:
    smallest = float(np.degrees(rotation_angles(motions.A[..., :3, :3]).min()))
    if method == "shiu" and smallest < 1.0:
        return (
            f"This method counts all motions alike, and one of them turns by {smallest:.2g} degrees only, which leaves "
            "its axis to the noise: leave small rotations out, or use another method."
        )
    return "Add motions that turn about other axes."


class _Fit(NamedTuple):
    X: Array  # (4, 4)
    W: Array | None
    iterations: int = 0
    by_error: Sequence[Array | None] = ()  # d xi_X / d xi_k (n, 6, 6) by robot and by camera poses
    by_error_W: Sequence[Array | None] = ()


def _fit(
    motions: Motions,
    noise: Noise | None,
    method: str,
    scale: float | None,
    everything: AllPairs | None,
    sensitive: bool,
) -> _Fit:
    """X and W by any method and, if ``sensitive``, their derivatives by the errors of the poses."""
    if not isinstance(method, str):
        raise InputError(f"Expected `method` to be a name, got {type(method).__name__}.")
    poses = motions.poses
    if scale is not None and method != "4dpa":
        raise InputError(f"Expected no `scale` with method {method!r}: it is the scaling factor of 4dpa.")
    if method in ROBOT_WORLD_METHODS:
        if poses is None:
            raise InputError(f"Method {method!r} solves G X C = W: it needs poses, got motions without poses.")
        if noise is not None and not sensitive:
            raise InputError(f"Method {method!r} works on poses: its covariance needs PoseNoise and kind 'poses'.")
        both = ROBOT_WORLD_METHODS[method]
        X, W = both(poses)
        return _Fit(X, W, 0, *(both.sensitivities(poses) if sensitive else ()))
    iterations = 0
    if everything:
        X = everything.solve()
    elif method == "4dpa":
        X = solve(motions.A, motions.B, scale=scale)
    else:
        found = find(method)
        weights = None
        if found.weighted and noise is not None:
            weights = noise if isinstance(noise, PairNoise) else noise_of_pairs(motions, noise)
        estimate = require_converged(found, found.estimate(motions.A, motions.B, weights))
        X, iterations = estimate.X, int(estimate.iterations)
    if poses is None:
        return _Fit(X, None, iterations)
    W = mean_target(poses, X)
    if not sensitive:
        return _Fit(X, W, iterations)
    assert isinstance(noise, PoseNoise)
    D = everything.sensitivities(X) if everything else pose_sensitivities(motions, noise, X, method, scale)
    return _Fit(X, W, iterations, D, target_sensitivities(poses, X, D))
