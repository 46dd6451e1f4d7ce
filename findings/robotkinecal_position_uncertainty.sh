#!/usr/bin/env bash
# robotkinecal 0.1.0: with measured positions the uncertainty of the joints counts every observation twice.
#
# SerialRobotKineCal calibrates from poses (six numbers an observation) or from positions of a laser tracker or a touch (three),
# and prints "Joints uncertainty" with either. Expected: variances from the residuals with rows minus parameters as degrees of
# freedom. Seen: the degrees of freedom are always 6 observations minus parameters. For poses that is right; for positions the
# variances are too small, 2.3 times with 40 positions of six joints, 5 times with 12, so that a fit that is nearly determined
# exactly looks well measured. What is printed is a variance (the norm of four, of numbers in rad and in m), not a deviation.
# The statistics are asked for with a linear problem of known noise; the robot models are replaced by empty modules.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" || exit 2
"$folder/env/bin/pip" install -q --no-deps "robotkinecal==0.1.0" || exit 2
"$folder/env/bin/python" - <<'PY'
import sys
from importlib.metadata import version
from unittest.mock import MagicMock

import numpy as np

for name in ("roboticstoolbox", "spatialmath", "spatialmath.base"):
    sys.modules[name] = MagicMock()
from robotkinecal.calibration import CalibrationResult

JOINTS, SD, DRAWS = 6, 1e-3, 400


def ratio(observations, size):
    """Return what is stated, over what holds, for the norm of each joint's variances: the mean of many draws."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(size * observations, 4 * JOINTS + size))
    true = SD**2 * np.diag(np.linalg.inv(A.T @ A))[: 4 * JOINTS].reshape(JOINTS, 4)
    stated = 0.0
    for _ in range(DRAWS):
        y = rng.normal(0, SD, (len(A), 1))
        x = np.linalg.lstsq(A, y, rcond=None)[0]
        nothing = [0.0] * observations
        result = CalibrationResult.IterationResult([None] * JOINTS, None, A, x, y, nothing, nothing)
        stated = stated + result.get_statistics()["joints_uncertainty"] / DRAWS
    return float(np.mean(stated / np.linalg.norm(true, axis=1)))


print(f"robotkinecal {version('robotkinecal')}: stated variance of the joints over the true one")
same = True
for observations, size in ((40, 6), (12, 6), (40, 3), (12, 3)):
    found = ratio(observations, size)
    parameters = 4 * JOINTS + size
    described = (size * observations - parameters) / (6 * observations - parameters)
    print(f"  {observations} {'poses' if size == 6 else 'positions'}, {parameters} parameters: {found:.3f}")
    same &= abs(found / described - 1) < 0.1
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
