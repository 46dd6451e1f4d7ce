"""The table of methods of docs/explanation/methods.md, from the registry and from one run with a fixed seed.

    python -m studies.methods_table [--trials 2000]

Per method: largest error on 200 noise-free problems of 5 motions of 1 to 179 degrees; then, for 15 simulated poses and
all 105 pairs (robot 0.1 mrad, 0.1 mm; camera 0.4 mrad, 0.4 mm): RMS errors over the trials as multiples of the smallest
in the column, and the mean NEES of X against the pose-aware covariance predicted without noise (6 if that is true).
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.noise_transport import covariance_of_poses, noise_of_pairs

NOISE = uq.PoseNoise.isotropic(robot=("0.1mrad", "0.1mm"), camera=("0.4mrad", "0.4mm"))


def errors(X: np.ndarray, truth: np.ndarray) -> np.ndarray:
    turn = (X[..., :3, :3] @ truth[..., :3, :3].swapaxes(-1, -2)).reshape(-1, 3, 3)
    theta = Rotation.from_matrix(turn).as_rotvec().reshape(*X.shape[:-2], 3)
    return np.concatenate([theta, X[..., :3, 3] - truth[..., :3, 3]], axis=-1)


def exact_problems(count: int, N: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(count, N, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    T = np.zeros((count, N + 1, 4, 4))
    T[:, :N, :3, :3] = Rotation.from_rotvec(axes * np.radians(rng.uniform(1, 179, (count, N, 1)))).as_matrix()
    T[:, N, :3, :3] = Rotation.random(count, rng=rng).as_matrix()
    T[..., :3, 3] = 0.5 * rng.normal(size=(count, N + 1, 3))
    T[..., 3, 3] = 1.0
    B, X = T[:, :N], T[:, N:]
    return X[:, 0], X @ B @ np.linalg.inv(X), B


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--trials", type=int, default=2000)
    trials = parser.parse_args().trials
    X, A, B = exact_problems(200, 5)
    drawn = uq.simulate(15, noise=NOISE, trials=trials, seed=1)
    exact = uq.PosePairs(drawn.truth.robot, drawn.truth.camera)
    motions, at_truth = uq.relative_motions(drawn, "all"), uq.relative_motions(exact, "all")
    weights = noise_of_pairs(at_truth, NOISE)
    rows = []
    for name, method in uq.METHODS.items():
        largest = np.abs(errors(method.estimate(A, B).X, X)).max()
        found = method.estimate(motions.A, motions.B, weights if method.weighted else None)
        rows.append((method, largest, errors(found.X, drawn.truth.X), uq.propagate(at_truth, noise=NOISE, method=name)))
    for method in uq.ROBOT_WORLD_METHODS.values():
        by_error = method.sensitivities(exact)[0]
        largest = np.abs(errors(method(exact).X, drawn.truth.X)).max()
        rows.append((method, largest, errors(method(drawn).X, drawn.truth.X), covariance_of_poses(by_error, NOISE)))
    rms = np.array([np.sqrt(np.mean(np.sum(e.reshape(-1, 2, 3) ** 2, axis=2), axis=0)) for _, _, e, _ in rows])
    print("| method | year | structure | form | exact data | rotation | translation | NEES |")
    print("|---|---|---|---|---|---|---|---|")
    for (method, largest, e, S), (turn, shift) in zip(rows, rms / rms.min(axis=0), strict=True):
        nees = float(np.mean(np.einsum("ti,ti->t", e, np.linalg.solve(S, e.T).T)))
        print(
            f"| `{method.name}` | {method.year} | {method.structure} | {method.form} | {largest:.0e} | {turn:.2f} | "
            f"{shift:.2f} | {nees:.2f} |"
        )
    low, high = stats.chi2.ppf([0.0005, 0.9995], 6 * trials) / trials
    print(f"\n99.9 % of means of a true NEES over {trials:,} trials lie between {low:.2f} and {high:.2f}.")


if __name__ == "__main__":
    main()
