"""The same numbers by all kernels of OpenBLAS, which differ in their rounding: each in a process of its own."""

import json
import os
import platform
import subprocess
import sys

import numpy as np
import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="kernels of x86-64"),
]

KERNELS = ("Haswell", "Sandybridge", "Nehalem", "Zen")
PROGRAM = """
import json, warnings
import numpy as np
import uq_handeye as uq
warnings.simplefilter("ignore")
noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
found = []
for k in range(6):
    setup = ("eye-in-hand", "eye-to-hand")[k % 2]
    drawn = uq.simulate(n_poses=(15, 30)[k % 2], noise=noise, seed=k, setup=setup)
    times = np.arange(drawn.n) * 3.7 + 0.5 if k % 3 == 0 else None
    result = uq.calibrate(uq.PosePairs(drawn.robot, drawn.camera, setup, times))
    found.append((result.X.tolist(), result.std.tolist(), result.headline))
sizes = {"left": ("1mrad", "0.5mm"), "right": ("1mrad", "0.5mm"), "arm": ("0.3mrad", "0.2mm")}
for k in range(2):
    rig, _ = uq.simulate_rig({"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=15, seed=k, noise=sizes)
    result = uq.calibrate(rig)
    found.append((result.poses.tolist(), np.sqrt(np.diag(result.covariance)).tolist(), result.text()))
print(json.dumps(found))
"""


def found_by(kernel):
    environment = os.environ | {"OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, env=environment, check=True)
    return json.loads(done.stdout)


def test_sizes_and_poses_do_not_depend_on_the_processor():
    """Rounding alone is below 1e-10; where an unknown arm hardly reaches a pose, its posture may be another one."""
    first, *others = map(found_by, KERNELS)
    for other in others:
        for (X, sd, headline), (Y, again, same) in zip(first, other, strict=True):
            assert np.abs(np.subtract(X, Y)).max() < 1e-3 * np.min(sd)
            np.testing.assert_allclose(again, sd, rtol=1e-3)
            assert same == headline
