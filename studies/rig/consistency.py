"""NEES of all unknowns and of relative poses over simulated draws, and RMS against separate fits.

Run ``python -m studies.rig.consistency [TRIALS [TRIALS_ESTIMATED]]``. With the noise given, fits start at the true
poses, which changes nothing but the time: starts have tests of their own.
"""

import sys
import time
from itertools import combinations

import numpy as np

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.calibration.rig_poses import relative_pose
from uq_handeye.core.geometry.se3 import logarithm
from uq_handeye.fit.graph.fit import RigFit, fit
from uq_handeye.fit.graph.graph import Graph
from uq_handeye.fit.graph.noise import given_noise
from uq_handeye.trials.simulation.several_cameras import with_noise

CASES = {
    "two cameras on a hand, two targets": (("arm",), {"c1": "arm", "c2": "arm"}, {"t1": "world", "t2": "world"}),
    "three fixed cameras": (("arm",), {"c1": "world", "c2": "world", "c3": "world"}, {"t1": "arm"}),
    "two arms, both moving": (("a", "b"), {"c1": "a"}, {"t1": "b"}),
}


def error(T: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return ``(theta, tau)``."""
    return np.concatenate([logarithm(T[:3, :3] @ true[:3, :3].T), T[:3, 3] - true[:3, 3]])


def rms(errors: list[np.ndarray]) -> str:
    """Format the RMS of rotation and translation."""
    e = np.array(errors).reshape(-1, 2, 3)
    turn, shift = np.sqrt((e**2).sum(axis=-1).mean(axis=0))
    return f"{1e3 * turn:.3f} mrad {1e3 * shift:.3f} mm"


def fitted(rig: uq.Rig, truth: dict[str, np.ndarray], noise: dict[str, tuple[str, str]]) -> tuple[RigFit, Graph]:
    """Return the fit with the noise given, from the true poses."""
    graph = Graph.of(rig)
    at = np.array([truth[name] for name in graph.names])
    return fit(graph, given_noise(rig, graph, noise), at), graph


def separate(rig: uq.Rig, name: str, truth: dict[str, np.ndarray], noise: dict[str, tuple[str, str]]) -> np.ndarray:
    """Return the pose of one camera from its own views."""
    views = [view for view in rig.views if view.camera == name]
    targets = {view.target: rig.targets[view.target] for view in views}
    single = uq.Rig(rig.arms, {name: rig.cameras[name]}, targets, tuple(views))
    return np.asarray(fitted(single, truth, {key: noise[key] for key in (*rig.arms, name)})[0].at[0])


def run(trials: int, estimated: bool) -> None:
    """Print one line for each rig."""
    for label, (arms, cameras, targets) in CASES.items():
        noise = dict.fromkeys((*arms, *cameras), ("0.5mrad", "0.3mm"))
        exact, truth = uq.simulate_rig(cameras, targets, arms=arms, n_poses=40, seed=5)
        nees, relative, joint, apart, start = [], [], [], [], time.process_time()
        for k in range(trials):
            rig = with_noise(exact, noise, k)
            if estimated:
                result = calibrate_rig(rig, robust=False, shared=False)
                names, at, S = result.names, result.poses, result.covariance
            else:
                found, graph = fitted(rig, truth, noise)
                names, at, S = graph.names, found.at, found.covariance
            xi = np.concatenate([error(T, truth[name]) for T, name in zip(at, names, strict=True)])
            nees.append(xi @ np.linalg.solve(S, xi) / len(xi))
            alone = {name: separate(rig, name, truth, noise) for name in cameras} if not estimated else {}
            for i, j in combinations(range(len(cameras)), 2):
                pose, by_i, by_j = relative_pose(at[i], at[j])
                true = np.linalg.inv(truth[names[i]]) @ truth[names[j]]
                D = np.zeros((6, len(S)))
                D[:, 6 * i : 6 * i + 6], D[:, 6 * j : 6 * j + 6] = by_i, by_j
                e = error(pose, true)
                relative.append(e @ np.linalg.solve(D @ S @ D.T, e) / 6)
                joint.append(e)
                if alone:
                    apart.append(error(np.linalg.inv(alone[names[i]]) @ alone[names[j]], true))
        what = "estimated" if estimated else "given"
        line = f"{label}; noise {what}; {trials} draws: NEES {np.mean(nees):.3f} +- {np.std(nees) / trials**0.5:.3f}"
        if relative:
            line += (
                f"; relative {np.mean(relative):.3f} +- {np.std(relative) / len(relative) ** 0.5:.3f}, RMS {rms(joint)}"
            )
        if apart:
            line += f", separate {rms(apart)}"
        print(line, f"({time.process_time() - start:.0f} s)", flush=True)


if __name__ == "__main__":
    counts = [int(text) for text in sys.argv[1:]] or [1000]
    run(counts[0], False)
    if len(counts) > 1:
        run(counts[1], True)
