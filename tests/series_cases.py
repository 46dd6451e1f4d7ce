"""Series of checks of simulated rigs, with what a check says of each."""

from types import SimpleNamespace

import numpy as np
from scipy.special import chdtrc

import uq_handeye as uq
from uq_handeye.calibration.evidence.new_poses import evidence_of_poses
from uq_handeye.core.geometry.se3 import inverse, perturb

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


def rig(setup="eye-in-hand", n=12):
    """A calibration with noise given, and its truth."""
    poses = uq.simulate(n_poses=n, noise=NOISE, seed=1, setup=setup)
    return uq.calibrate(poses, noise=NOISE, shared=[], correlation="none"), poses.truth


def new_poses(truth, setup, n, rng, shift=0.0):
    """Poses of the same rig, X moved by the shift."""
    G = uq.simulate(n_poses=n, seed=rng, setup=setup).truth.robot
    X = perturb(truth.X, np.zeros(6) + shift)
    C = inverse(X) @ inverse(inverse(G) if setup == "eye-to-hand" else G) @ truth.W
    noisy = [
        perturb(T, rng.standard_normal((n, 6)) * np.sqrt(np.diag(S))) for T, S in ((G, NOISE.robot), (C, NOISE.camera))
    ]
    return uq.PosePairs(*noisy, setup)


def plain_check(result, poses, **more):
    """The numbers of a check, with noise given."""
    evidence = evidence_of_poses(result, poses)
    p = float(chdtrc(evidence.dof, evidence.d2))
    values = {
        "d2": evidence.d2, "dof": evidence.dof, "p_value": p, "noise_dof": None, "candidates": (), "findings": (),
        "status": "changed" if p < 0.05 else "unchanged",
        "causes": {"X": evidence.explained_by(-evidence.linear.J[..., :6])},
    }  # fmt: skip
    return SimpleNamespace(**values | more)
