"""Factor graphs of GTSAM for hand-eye calibration, and how far `ml` is from their maximum and marginals.

The graph: a prior on every latent robot pose at its measurement, and for every camera pose a factor that predicts it as
``inv(X) inv(G) W``; GTSAM's own solver, Lie group and marginals. Used by ``test_against_gtsam.py`` and the
studies.
"""

import os
from pathlib import Path

import numpy as np
import pytest
from support import difference, jacobian, moved, random_covariance, whitened_eigenvalues

import uq_handeye as uq
from uq_handeye.fit.likelihood.gauss_helmert import maximum_likelihood

gtsam = pytest.importorskip("gtsam")
x, w = gtsam.symbol("x", 0), gtsam.symbol("w", 0)


def gaussian(covariance):
    """Not the ``smart`` way, GTSAM's default: that drops every correlation where no covariance exceeds 1e-9."""
    return gtsam.noiseModel.Gaussian.Covariance(covariance, False)


def camera_factor(keys, measured, noise, inverted):
    """``Log(measured^-1 inv(X) inv(G) W)``, G inverted for eye-to-hand, with its derivatives."""
    back = measured.inverse()

    def error(this, values, derivatives):
        robot, X, W = (values.atPose3(key) for key in keys)
        to_target = (robot if inverted else robot.inverse()).compose(W)
        predicted = X.inverse().compose(to_target)
        e = gtsam.Pose3.Logmap(back.compose(predicted))
        if derivatives is not None:
            J = gtsam.Pose3.LogmapDerivative(e)
            through = W if inverted else to_target
            derivatives[0] = (1 if inverted else -1) * J @ through.inverse().AdjointMap()
            derivatives[1] = -J @ predicted.inverse().AdjointMap()
            derivatives[2] = J
        return e

    return gtsam.CustomFactor(noise, list(keys), error)


def native(poses, noise):
    """Every error as GTSAM has it, its covariance converted at the measured pose."""
    graph = gtsam.NonlinearFactorGraph()
    measured = [[gtsam.Pose3(T) for T in stack] for stack in (poses.robot, poses.camera)]
    models = [
        [gaussian(S) for S in uq.to_convention(S, stack, "gtsam")]
        for S, stack in ((noise.robot, poses.robot), (noise.camera, poses.camera))
    ]
    for k in range(poses.n):
        key = gtsam.symbol("g", k)
        graph.add(gtsam.PriorFactorPose3(key, measured[0][k], models[0][k]))
        graph.add(camera_factor((key, x, w), measured[1][k], models[1][k], poses.setup == "eye-to-hand"))
    return graph


def in_our_convention(poses, noise):
    """The same graph with the error ``xi`` of ``measured = moved(latent, xi)``, differentiated numerically."""
    graph = gtsam.NonlinearFactorGraph()
    turn = np.linalg.inv if poses.setup == "eye-in-hand" else (lambda T: T)

    def factor(keys, measured, covariance, predict):
        def error(this, values, derivatives):
            at = [values.atPose3(key).matrix() for key in keys]
            if derivatives is not None:
                for k, T in enumerate(at):
                    turned = np.kron(np.eye(2), T[:3, :3])  # T Exp(d) is moved(T, (R d_theta, R d_tau)) to first order

                    def of(d, k=k, T=T, turned=turned):
                        return difference(measured, predict(*at[:k], moved(T, d @ turned.T), *at[k + 1 :]))

                    derivatives[k] = jacobian(of, 6)
            return difference(measured, predict(*at))

        graph.add(gtsam.CustomFactor(gaussian(covariance), list(keys), error))

    for k in range(poses.n):
        key = gtsam.symbol("g", k)
        factor((key,), poses.robot[k], noise.robot, lambda G: G)
        factor((key, x, w), poses.camera[k], noise.camera, lambda G, X, W: np.linalg.inv(X) @ turn(G) @ W)
    return graph


def by_gtsam(poses, noise, X, W, graph_of=native):
    """X, W and the covariances of both in the toolkit's convention, from a start at X and W."""
    graph = graph_of(poses, noise)
    values = gtsam.Values()
    values.insert(x, gtsam.Pose3(X))
    values.insert(w, gtsam.Pose3(W))
    for k, T in enumerate(poses.robot):
        values.insert(gtsam.symbol("g", k), gtsam.Pose3(T))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-15)
    parameters.setAbsoluteErrorTol(1e-15)
    values = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    marginals = gtsam.Marginals(graph, values)
    found = [values.atPose3(key).matrix() for key in (x, w)]
    covariances = [
        uq.from_convention(marginals.marginalCovariance(key), T, "gtsam") for key, T in zip((x, w), found, strict=True)
    ]
    return *found, *covariances


class Difference:
    """Difference between `ml` and GTSAM: X and W in standard deviations, and the largest of |eigenvalue - 1| of the
    whitened covariances.
    """

    def __init__(self, poses, noise, graph_of=native):
        ours = maximum_likelihood(poses, noise)
        X, W, covariance_X, covariance_W = by_gtsam(poses, noise, ours.X, ours.W, graph_of)
        self.shift, self.spread = [], []
        for T, S, other, reference in (
            (ours.X, ours.covariance_X, X, covariance_X),
            (ours.W, ours.covariance_W, W, covariance_W),
        ):
            e = difference(T, other)
            self.shift.append(float(np.sqrt(e @ np.linalg.solve(reference, e))))
            self.spread.append(float(np.abs(whitened_eigenvalues(S, reference) - 1).max()))


def poses_of(name, count=None, setup="eye-in-hand"):
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / name
    poses = uq.read_poses(folder / "robot.csv", folder / "camera.csv", setup=setup)
    robot, camera = poses.robot[:count], poses.camera[:count]
    # a fixed camera; its file holds inverse poses, which fit as those of an eye-in-hand camera
    return uq.PosePairs(robot, np.linalg.inv(camera) if setup == "eye-to-hand" else camera, setup)


def isotropic(robot, camera):
    return uq.PoseNoise.isotropic(robot=robot, camera=camera)


def anisotropic(sd):
    """Full 6x6 on both sides, deviations over a factor of 9, rotation and translation correlated; the same always."""
    rng = np.random.default_rng([20190508, 9])
    return uq.PoseNoise(0.04 * random_covariance(rng, sd=sd), random_covariance(rng, sd=sd))


REAL = {
    "kuka, 0.05 deg 0.5 mm": ("kuka_1", None, "eye-in-hand", isotropic(("0.02deg", "0.1mm"), ("0.05deg", "0.5mm"))),
    "kuka, full 6x6": ("kuka_1", None, "eye-in-hand", anisotropic(2e-3)),
    "kuka, noise a tenth": ("kuka_1", None, "eye-in-hand", isotropic(("0.002deg", "0.01mm"), ("0.005deg", "0.05mm"))),
    "rendered, 0.1 mrad 0.1 mm": (
        "synthetic_camera_2",
        None,
        "eye-in-hand",
        isotropic(("0.01mrad", "0.01mm"), ("0.1mrad", "0.1mm")),
    ),
    "rendered, full 6x6": ("synthetic_camera_2", None, "eye-in-hand", anisotropic(1e-3)),
    "nguyen, 0.5 deg 3 mm": ("nguyen_pham", 100, "eye-to-hand", isotropic(("0.02deg", "0.1mm"), ("0.5deg", "3mm"))),
    "nguyen, full 6x6": ("nguyen_pham", 100, "eye-to-hand", anisotropic(5e-3)),
    "nguyen, as stored": ("nguyen_pham", 100, "eye-in-hand", isotropic(("0.02deg", "0.1mm"), ("0.5deg", "3mm"))),
    "nguyen, as stored, full 6x6": ("nguyen_pham", 100, "eye-in-hand", anisotropic(5e-3)),
}
