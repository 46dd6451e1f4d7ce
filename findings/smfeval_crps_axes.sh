#!/usr/bin/env bash
# smfeval 0.4.0: in one report, two scores take the covariance for one in the body's axes and two for one in the world's.
#
# With "right_perturbation" the translation of a covariance is in the axes of the body. Expected: every score of a proper kind
# is best for the covariance that the errors were drawn from. Seen: NEES, coverage and the log score turn the error into the
# body's axes and find the true covariance calibrated; CRPS and the energy score put the same 3 x 3 block on the world's axes,
# and prefer a file whose covariances were turned into the world, which coverage calls wrong. For a calibrated Gaussian belief
# the mean CRPS is sd / sqrt(pi) per axis of the world: the true file is far from it, the turned one has it. Nothing differs
# while the covariance is a ball or the body never turns. Who picks a filter, or a noise, by CRPS picks the wrong axes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "scipy==1.15.3" "smfeval==0.4.0" || exit 2
cd "$folder"
PATH="$folder/env/bin:$PATH" "$folder/env/bin/python" - <<'PY'
import re
import subprocess
import sys
from importlib.metadata import version

import numpy as np
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

POSES = 400
S = np.diag([0.2, 0.02, 0.02, 0.01, 0.01, 0.01]) ** 2  # translation (m), rotation (rad)
rng = np.random.default_rng(0)


def exp(xi):
    x, y, z = xi[3:]
    return expm(np.array([[0, -z, y, xi[0]], [z, 0, -x, xi[1]], [-y, x, 0, xi[2]], [0, 0, 0, 0]]))


def line(number, T):
    return " ".join(f"{x:.9f}" for x in [1000 + 0.1 * number, *T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat()]) + "\n"


truths = [np.eye(4) for _ in range(POSES)]
for T, R in zip(truths, Rotation.random(POSES, random_state=1).as_matrix()):
    T[:3, :3], T[:3, 3] = R, rng.uniform(-3, 3, 3)
estimates = [T @ exp(xi) for T, xi in zip(truths, rng.multivariate_normal(np.zeros(6), S, POSES))]
sd_world = [np.sqrt(np.diag(M[:3, :3] @ S[:3, :3] @ M[:3, :3].T)) for M in estimates]
calibrated = np.mean(sd_world) / np.sqrt(np.pi)
for name, poses in (("reference.tum", truths), ("estimate.tum", estimates)):
    with open(name, "w") as file:
        file.writelines(line(number, T) for number, T in enumerate(poses))
print(f"smfeval {version('smfeval')}: {POSES} poses with errors drawn from a right perturbation; CRPS should be {calibrated:.4f} m")
seen = {}
for name in ("true, in the body's axes", "turned into the world's axes"):
    with open("estimate.cov", "w") as file:
        for number, M in enumerate(estimates):
            turn = np.kron(np.eye(2), M[:3, :3] if name.startswith("turned") else np.eye(3))
            C = turn @ S @ turn.T
            packed = " ".join(f"{C[row, column]:.12g}" for row in range(6) for column in range(row + 1))
            file.write(f"{1000 + 0.1 * number:.9f} {packed}\n")
    command = ["smfeval", "score", "estimate.tum", "reference.tum", "--cov", "estimate.cov", "--align", "none"]
    command += ["--est-body-frame", "imu", "--ref-body-frame", "imu", "--tangent-convention", "right_perturbation"]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    keys = {"CRPS": "CRPS", "energy": "Energy score", "log": "Log score", "coverage": "Mahalanobis coverage"}
    seen[name] = {key: float(re.search(label + r"[^\n]*?(?:mean|:) *(-?[\d.]+)", text)[1]) for key, label in keys.items()}
    print(f"  {name}: " + ", ".join(f"{key} {value:g}{' %' if key == 'coverage' else ''}" for key, value in seen[name].items()))
true, turned = seen.values()
same = true["CRPS"] > 1.1 * turned["CRPS"] and abs(turned["CRPS"] / calibrated - 1) < 0.1
same &= abs(true["coverage"] - 90) < 5 and turned["coverage"] < 70 and true["log"] < turned["log"] - 1
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
