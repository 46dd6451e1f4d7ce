"""Problems that Monte Carlo draws a chunk of in about ten milliseconds, and programs that run them."""

import os
import subprocess
import sys

import numpy as np
from support import SEED, exact_motions, random_covariance

import uq_handeye as uq

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))

# Runs in a folder of its own, argv: folder, trials, workers.
PROGRAM = """
import sys
import uq_handeye as uq
from uq_handeye.trials.validation.monte_carlo import chunks as workers

noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
workers.START_SECONDS = 0.0

if __name__ == "__main__":
    folder, trials, count = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    poses = uq.simulate(12, noise=noise, seed=7)
    print("ready", flush=True)
    result = uq.monte_carlo(
        poses, noise=noise, trials=trials, workers=count, directory=folder, resume=True
    )
    print(result.complete, result.reason, result.trials, flush=True)
"""


def poses_of_program():
    return uq.simulate(12, noise=NOISE, seed=7)


def pairs_problem(N=20):
    """Motions and full covariances on both sides."""
    rng = np.random.default_rng([SEED, 5])
    _, A, B = exact_motions(rng, N)
    return uq.Motions(A, B), uq.PairNoise(random_covariance(rng), random_covariance(rng))


def start(program, *arguments, **options):
    """A process that runs a program, at the head of a group of its own; the caller ends it."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    command = [sys.executable, program, *map(str, arguments)]
    return subprocess.Popen(command, start_new_session=True, env=environment, **pipes, **options)


def assert_same(one, other):
    """Equal to the last bit, in all but the time taken."""
    np.testing.assert_array_equal(one.errors, other.errors)
    a, b = (result.to_dict() for result in (one, other))
    for name in ("seconds", "notes", "resumed"):
        del a[name], b[name]
    assert a == b
    for name, array in one.consistency.sums.to_arrays().items():
        np.testing.assert_array_equal(array, other.consistency.sums.to_arrays()[name])
