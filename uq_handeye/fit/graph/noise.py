"""Noise of a rig: a covariance for each arm and each camera, and errors that poses share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.runtime.read_only import ReadOnlyArrays
from ...errors import InputError
from ...model.error_terms.key import ErrorKey, Kind, Owner
from ...model.error_terms.keys import INTRINSICS
from ...model.error_terms.sizes import Size
from ...model.error_terms.term import ErrorTerm
from ...model.kinematics.arm_terms import terms_of_arm
from ...model.rig.description import Rig
from ...model.rig.noise_by_name import NoiseByName, by_name, covariance_of
from .graph import Graph


@dataclass(frozen=True, eq=False)
class RigNoise(ReadOnlyArrays):
    """Covariances of the measured poses of a `Graph`; see its indices.

    ``K_robot`` and ``K_camera``: effects of m errors that poses share, each with the standard deviation 1.
    """

    robot: Array  # (P, 6, 6)
    camera: Array  # (E, 6, 6)
    K_robot: Array  # (P, 6, m)
    K_camera: Array  # (E, 6, m)
    keys: tuple[ErrorKey, ...] = ()  # of the m

    @classmethod
    def of_own(cls, robot: Array, camera: Array) -> RigNoise:
        """Build noise that no two poses share."""
        return cls(robot, camera, np.zeros((len(robot), 6, 0)), np.zeros((len(camera), 6, 0)))

    @property
    def count(self) -> int:
        """Number of shared errors m."""
        return int(self.K_camera.shape[-1])

    def with_blocks(self, terms: Iterable[ErrorTerm]) -> RigNoise:
        """Return the noise with what error terms add to each pose by itself, at the medians of their sizes."""
        own = {"robot": self.robot.copy(), "camera": self.camera.copy()}
        for term in terms:
            if term.block is not None:
                own[term.side] += term.size.median**2 * term.block @ term.block.mT
        return replace(self, robot=own["robot"], camera=own["camera"])

    def with_columns(self, terms: Iterable[ErrorTerm]) -> RigNoise:
        """Return the noise with the columns of further error terms, at the medians of their sizes."""
        K, keys = {"robot": [self.K_robot], "camera": [self.K_camera]}, list(self.keys)
        for term in terms:
            if term.columns is None:
                continue
            for side, columns in K.items():
                of_side = side == term.side
                columns.append(
                    term.size.median * term.columns if of_side else np.zeros((len(columns[0]), 6, term.count))
                )
            keys += term.keys
        robot, camera = (np.concatenate(columns, axis=-1) for columns in K.values())
        return replace(self, K_robot=robot, K_camera=camera, keys=tuple(keys))

    def in_order(self, keys: tuple[ErrorKey, ...]) -> RigNoise:
        """Return the noise with columns for ``keys``, which contain all its own; 0 for those that it does not have."""
        place = {key: k for k, key in enumerate(keys)}
        at = [place[key] for key in self.keys]
        robot, camera = (np.zeros((*K.shape[:2], len(keys))) for K in (self.K_robot, self.K_camera))
        robot[..., at], camera[..., at] = self.K_robot, self.K_camera
        return replace(self, K_robot=robot, K_camera=camera, keys=keys)


def given_noise(rig: Rig, graph: Graph, noise: NoiseByName) -> RigNoise:
    """Return the noise that was given, for the poses of a graph; raises `InputError` where one is missing.

    ``noise``: mapping of the names of arms and cameras to (rotation, translation) standard deviations, covariances
    (6, 6), of arms also (n, 6, 6), or "exact"; or a `PoseNoise` for all arms and all cameras. The errors of arms with
    kinematics come on top, as large as those of their population.
    """
    noise = by_name(rig, noise)
    own = {view.camera for view in rig.views if view.covariance is None}
    robot, camera = np.zeros((graph.P, 6, 6)), np.zeros((graph.E, 6, 6))
    for k, (name, arm) in enumerate(rig.arms.items()):
        S = covariance_of(noise, name, len(arm.poses))
        of = graph.arm == k
        robot[of] = S if S.ndim == 2 else S[graph.pose[of]]
    for name in rig.cameras:
        if name in own:
            S = covariance_of(noise, name, None)
            camera[np.isin(graph.view, [k for k, view in enumerate(rig.views) if view.camera == name])] = S
    given, some = given_covariances(rig, graph)
    camera[some] = given[some]
    chains = [
        term
        for name, arm in rig.arms.items()
        if arm.kinematics is not None
        for term in kinematic_components(rig, graph, name)
    ]
    return RigNoise.of_own(robot, camera).with_columns([*calibrated_intrinsics(rig, graph).values(), *chains])


def given_covariances(rig: Rig, graph: Graph) -> tuple[Array, NDArray[np.bool_]]:
    """Return the covariances (E, 6, 6) of views that have one, 0 for the others, and which have one (E,)."""
    found, some = np.zeros((graph.E, 6, 6)), np.zeros(graph.E, dtype=bool)
    for k, view in enumerate(rig.views):
        if (S := view.covariance) is not None:
            some |= (of := graph.view == k)
            found[of] = S if S.ndim == 2 else S[graph.row[of]]
    return found, some


def calibrated_intrinsics(rig: Rig, graph: Graph) -> dict[str, ErrorTerm]:
    """Return the errors of the calibration of each camera whose views come with their effects, by its name."""
    found = {}
    for name in rig.cameras:
        sizes = {view.intrinsics.shape[-1] for view in rig.views if view.camera == name and view.intrinsics is not None}
        if not sizes:
            continue
        if len(sizes) > 1:
            raise InputError(f"Expected as many errors of intrinsics in all views of {name!r}, got {sorted(sizes)}.")
        columns = np.zeros((graph.E, 6, sizes.pop()))
        for k, view in enumerate(rig.views):
            if view.camera == name and view.intrinsics is not None:
                of = graph.view == k
                columns[of] = view.intrinsics[graph.row[of]]
        found[name] = ErrorTerm(INTRINSICS.of(name), "camera", Size(1.0), columns=columns)
    return found


def kinematic_components(rig: Rig, graph: Graph, name: str) -> list[ErrorTerm]:
    """Errors of the chain of an arm by group, as of one camera (`terms_of_arm`), and the noise of its joints."""
    arm, of = rig.arms[name], graph.arm == list(rig.arms).index(name)
    assert arm.kinematics is not None and arm.joints is not None
    columns = arm.errors.columns(arm.kinematics, arm.joints[graph.pose[of]], None, arm.by_poses)
    return [_of_arm(part, of, name) for part in terms_of_arm(columns)]


def _of_arm(part: ErrorTerm, of: NDArray[np.bool_], name: str) -> ErrorTerm:
    """Return a component of the poses of one arm as one of all robot poses (P,), 0 for the others."""
    values: dict[str, Any] = {}
    for what in ("columns", "block"):
        if (own := getattr(part, what)) is not None:
            values[what] = np.zeros((len(of), *own.shape[1:]))
            values[what][of] = own
    return replace(part, key=part.key.of(name), keys=tuple(key.of(name) for key in part.keys), **values)


def given_key(side: str, name: str) -> ErrorKey:
    """Return the key of the whole noise of an arm or a camera, by its side."""
    return ErrorKey(Owner(side), Kind.GIVEN, name=name)
