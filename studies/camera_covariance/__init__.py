"""Value of the joint covariance of camera poses: errors of X against what each noise model says of them.

    python -m studies.camera_covariance [--full] [-o results]

Simulated cameras look at a board of 9 x 6 corners from 20 poses each: focal length, centre, distortion, X and poses are
drawn again for every set, the corners have Gaussian noise, the robot little. Every set is calibrated from its corners
only. X is then estimated with the joint covariance of the camera poses, with the same covariance without the
correlations between poses (independent noise), with the joint one beside robot noise that is estimated as well, and, in
the first sets, by bundle adjustment of everything. 1,000 sets with ``--full``, 60 without.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.common.quantiles import quantile_figure
from studies.common.scores import true_means
from studies.common.study import Study, Tables, markdown
from uq_handeye.core.geometry.se3 import inverse, perturb
from uq_handeye.core.presentation.colours import BLUE, GREEN, ORANGE
from uq_handeye.core.progress import progress_bar
from uq_handeye.fit.graph.gauss_helmert import Fit, efficient
from uq_handeye.fit.graph.goodness_of_fit import effective_dof
from uq_handeye.fit.graph.noise_of_data import estimate_noise
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.corners import Corners
from uq_handeye.model.camera.models import MODELS
from uq_handeye.model.errors.models import marginals

SEED = 2019
SIZE = (1280, 960)
SETS, FULL = 60, 1_000
BUNDLES = 20  # one set in so many is adjusted as a whole too
PIXEL = 0.2
ROBOT = np.diag([5e-5] * 3 + [2e-5] * 3) ** 2  # 0.003 deg, 0.02 mm
NAMES = {
    "joint": "joint covariance of the camera poses",
    "independent": "same covariance without correlations between poses",
    "estimated": "joint, robot noise estimated",
}


def transforms(turn: Rotation, move: Any) -> Any:
    T = np.zeros((*np.shape(move)[:-1], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = turn.as_matrix(), move, 1.0
    return T


def board(columns: int = 9, rows: int = 6, square: float = 0.03) -> Any:
    """Points (m, 3) of a flat board."""
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return square * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1)


def recorded(
    rng: np.random.Generator,
    n: int = 20,
    *,
    model: str = "pinhole",
    setup: str = "eye-in-hand",
    pixel: float = PIXEL,
    robot: Any = ROBOT,
    points: Any = None,
    bent: Any = 0.0,
    parameters: Any = None,
) -> tuple[Corners, Any, Any]:
    """Corners of one random camera, robot poses (n, 4, 4) with noise, and the true X.

    The camera looks at the board from 0.5 to 0.9 m, or farther at a larger one, tilted up to 45 degrees; eye-in-hand,
    or the mirror image of it. ``bent`` (m, 3) is how the points of the board lie beside ``points``, where they are
    meant to be; ``parameters`` None: drawn.
    """
    if parameters is None:
        f = rng.uniform(900, 1500)
        parameters = np.zeros(len(MODELS[model].names))
        parameters[:4] = f, f * rng.uniform(0.99, 1.01), *(0.5 * np.array(SIZE) + rng.uniform(-30, 30, 2))
        if model == "brown":
            parameters[4:6] = rng.uniform(-0.25, 0.1), rng.uniform(-0.05, 0.05)
    points = board() if points is None else points
    middle = points.mean(axis=0)
    far = np.ptp(points[:, 0]) / np.ptp(board()[:, 0])
    axis = rng.uniform(0, 2 * np.pi, n)
    tilt = rng.uniform(0, np.radians(45), n)
    turn = Rotation.from_rotvec(np.stack([tilt * np.cos(axis), tilt * np.sin(axis), np.zeros(n)], axis=-1))
    turn = turn * Rotation.from_euler("z", rng.uniform(-np.pi, np.pi, (n, 1)))
    away = far * rng.uniform(0.5, 0.9, n)
    aside = rng.uniform(-0.12, 0.12, (n, 2)) * away[:, None] * 1200 / parameters[0]
    camera = transforms(turn, np.concatenate([aside, away[:, None]], axis=-1) - turn.apply(middle))
    there = (points + bent) @ camera[:, :3, :3].mT + camera[:, None, :3, 3]
    seen = MODELS[model].project(parameters, there).pixels
    seen = seen + pixel * rng.normal(size=seen.shape)
    inside = ((seen > 0) & (seen < np.array(SIZE) - 1)).all(axis=-1)
    row, which = np.nonzero(inside)
    X = transforms(Rotation.random(rng=rng), rng.normal(size=3) * 0.1)
    W = transforms(Rotation.random(rng=rng), rng.normal(size=3) * 0.5)
    G = W @ inverse(X @ camera)
    true = G if setup == "eye-in-hand" else inverse(G)
    xi = np.zeros((n, 6)) if robot is None else rng.multivariate_normal(np.zeros(6), robot, n)
    return Corners(row, points[which], seen[inside]), perturb(true, xi), X


def poses_of(corners: Corners, robot: Any, model: str = "pinhole", setup: str = "eye-in-hand") -> uq.PosePairs:
    """The calibrated camera beside the robot; the board is flat."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        seen = calibrate_camera(corners, SIZE, model, shape="flat")
    return uq.PosePairs(robot[seen.rows], seen.poses, setup, camera_calibration=seen)


def adjusted_at_once(poses: uq.PosePairs, robot: Any, at: Fit) -> tuple[Any, Any]:
    """X and its covariance by least squares of the corners over intrinsics, X, W and the robot poses, none eliminated.

    ``robot`` is the diagonal covariance (6, 6) of each robot pose, ``at`` a fit to start from.
    """
    seen = poses.camera_calibration
    assert seen is not None and at.W is not None
    start_X, start_W = at.X, at.W
    bundle, picture, n = seen.bundle, seen.corners.picture, poses.n
    sd, noise = np.sqrt(np.diag(robot)), seen.bundle.picture_noise[picture, None]
    units = np.sqrt(np.diag(bundle.covariance))[bundle.free]
    q = 12 + len(units)

    def residuals(x: Any) -> Any:
        X, W, k = perturb(start_X, x[:6]), perturb(start_W, x[6:12]), bundle.parameters.copy()
        k[bundle.free] += units * x[12:q]
        u = x[q:].reshape(n, 6)
        G = perturb(poses.robot, -u * sd)
        C = inverse((G if poses.setup == "eye-in-hand" else inverse(G)) @ X) @ W
        points = (C[picture, :3, :3] @ seen.corners.points[..., None])[..., 0] + C[picture, :3, 3]
        pixels = bundle.model.project(k[: len(bundle.model.names)], points).pixels
        off = (pixels - seen.corners.pixels) / noise * bundle.used[:, None]
        return np.concatenate([off.ravel(), u.ravel()])

    start = np.zeros(q + 6 * n)
    found = least_squares(residuals, start, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-10)
    J = np.asarray(found.jac)
    unit = 1.0 / np.linalg.norm(J, axis=0)
    covariance = np.linalg.inv(J.T @ J * np.outer(unit, unit)) * np.outer(unit, unit)
    return perturb(at.X, found.x[:6]), covariance[:6, :6]


def error(X: Any, truth: Any) -> Any:
    """(theta, tau) of X (4, 4)."""
    turn = Rotation.from_matrix(X[:3, :3] @ truth[:3, :3].T).as_rotvec()
    return np.concatenate([turn, X[:3, 3] - truth[:3, 3]])


def one_set(seed: int, with_bundle: bool) -> dict[str, float]:
    """Squared distances and errors of one camera."""
    corners, robot, X = recorded(np.random.default_rng([SEED, seed]))
    poses = poses_of(corners, robot)
    assert poses.camera_calibration is not None
    S = poses.camera_calibration.covariance
    found: dict[str, float] = {}
    fits = {
        "joint": efficient(poses, uq.PoseNoise(ROBOT, S)),
        "independent": efficient(poses, uq.PoseNoise(ROBOT, marginals(S))),
    }
    estimate = estimate_noise(poses)
    assert estimate.noise is not None
    fits["estimated"] = efficient(poses, estimate.noise)
    for name, fit in fits.items():
        e = error(fit.X, X)
        found[f"{name}_d2"] = float(e @ np.linalg.solve(fit.covariance_X, e))
        found[f"{name}_mm"] = 1e3 * float(np.linalg.norm(e[3:]))
    found["estimated_dof"] = effective_dof(fits["estimated"], estimate)
    factor = estimate.camera_factor
    found["factor_p"] = np.nan if factor is None else factor.p_value
    if with_bundle:
        at = fits["joint"]
        X, covariance = adjusted_at_once(poses, ROBOT, at)
        e = error(X, at.X)
        found["bundle_sd"] = float(np.sqrt(e @ np.linalg.solve(at.covariance_X, e)))
        ratio = np.linalg.eigvals(np.linalg.solve(at.covariance_X, covariance)).real
        found["bundle_variance"] = float(np.abs(ratio - 1).max())
    return found


def measure(full: bool) -> Tables:
    sets = FULL if full else SETS
    rows = []
    with progress_bar("cameras", sets, "cameras") as advance:
        for seed in range(sets):
            rows.append(one_set(seed, seed % BUNDLES == 0))
            advance(1)
    return {"sets": pd.DataFrame(rows)}


def findings(tables: Tables) -> str:
    table = tables["sets"]
    n = len(table)
    low, high = true_means(n)
    rows, verdicts = [], []
    for name, words in NAMES.items():
        d2 = table[f"{name}_d2"]
        limit = 6 * stats.f.ppf(0.95, 6, table["estimated_dof"]) if name == "estimated" else stats.chi2.ppf(0.95, 6)
        mean = float(d2.mean())
        rms = float(np.sqrt((table[f"{name}_mm"] ** 2).mean()))
        rows.append([words, f"{mean:.2f}", f"{100 * (d2 <= limit).mean():.1f} %", f"{rms:.3f}"])
        if name != "estimated":  # which has heavier tails than chi-square: its ellipsoid is that of F
            verdict = "consistent with the errors"
            if mean > high:
                verdict = f"too small: a mean NEES of {mean:.0f} says that the deviations are, roughly, "
                verdict += f"{np.sqrt(mean / 6):.1f} times larger"
            elif mean < low:
                verdict = "too large"
            verdicts.append(f"With the {words}, the covariance of X is {verdict}.")
    head = ["camera noise", "mean NEES (6)", "truth inside the 95 % ellipsoid", "RMS error of translation (mm)"]
    bundles = table["bundle_sd"].dropna()
    p = table["factor_p"].dropna()
    return (
        f"{n:,} simulated cameras, 20 poses of up to 54 corners each, {PIXEL} pixels. The mean NEES of "
        f"a consistent covariance lies between {low:.2f} and {high:.2f} (99.9 %). Where robot noise is estimated the "
        f"ellipsoid is that of the F distribution, and its mean NEES a little larger.\n\n{markdown(head, rows)}\n\n"
        f"{' '.join(verdicts)}\n\n"
        f"Bundle adjustment of everything ({len(bundles)} sets) gives X within {bundles.max():.3f} standard deviations "
        f"of that with the joint covariance ({bundles.median():.3f} in the median), and variances within "
        f"{100 * table['bundle_variance'].max():.1f} %."
        f"{_of_the_test(p)}"
    )


def _of_the_test(p: Any) -> str:
    """Return how often the test of the camera's covariance rejects; nothing where no estimate carries such a test."""
    if not len(p):
        return ""
    below = [100 * float((p < level).mean()) for level in (0.05, 0.001)]
    return (
        f"\n\nThe test of the camera's covariance, which is true here, has p below 5 % in {below[0]:.1f} % "
        f"of {len(p)} sets and below 0.1 % in {below[1]:.1f} %."
    )


def figures(tables: Tables) -> Mapping[str, Any]:
    """The distribution of d^2 against chi-square."""
    looks = {"joint": (BLUE, "-"), "independent": (ORANGE, "--"), "estimated": (GREEN, "-.")}
    curves = [(tables["sets"][f"{name}_d2"], words, *looks[name]) for name, words in NAMES.items()]
    return {"camera_covariance": quantile_figure(curves)}


STUDY = Study("camera_covariance", measure, findings, figures, packages=("opencv-python-headless",))
