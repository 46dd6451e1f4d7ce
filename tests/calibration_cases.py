"""Noise, data sets and quiet calls that the tests of calibrate() share."""

import warnings

import numpy as np
from support import (
    SEED,
    draw,
    moved,
    random_transforms,
)

import uq_handeye as uq
from uq_handeye.fit.likelihood.gauss_helmert import efficient, maximum_likelihood

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
PAIR_NOISE = uq.PairNoise.isotropic(A=("0.02deg", "0.05mm"), B=("0.1deg", "0.5mm"))
SETUPS = ("eye-in-hand", "eye-to-hand")
FITS = {"efficient": efficient, "ml": maximum_likelihood}
# Two starts of the same iteration, or JSON's digits, are this close.
CLOSE = 1e-6
# Said of every estimated noise where a common error of 0.1 % would show.


def motions_alone(n=30, seed=SEED):
    """Independent motions that come without poses, with the noise of PAIR_NOISE."""
    rng = np.random.default_rng(seed)
    X, B = random_transforms(rng), random_transforms(rng, (n,), largest=2.0)
    A = X @ B @ np.linalg.inv(X)
    return X, uq.Motions(moved(A, draw(rng, PAIR_NOISE.A, (n,))), moved(B, draw(rng, PAIR_NOISE.B, (n,))))


def with_wrong(poses, row, metres=0.05):
    camera = poses.camera.copy()
    camera[row, 0, 3] += metres
    return uq.PosePairs(poses.robot, camera, poses.setup)


def quietly(data, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return uq.calibrate(data, **options)
