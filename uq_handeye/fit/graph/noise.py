"""Noise of a rig: a covariance for each arm and each camera, and errors that poses share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError
from ...model.errors.columns import some_rows
from ...model.errors.key import ErrorKey, Kind, Owner
from ...model.errors.keys import INTRINSICS, SCENE_EXCESS, SCENE_FEATURES, TARGET_SCALE
from ...model.errors.sizes import SIZES, Size
from ...model.errors.term import ErrorTerm
from ...model.rig.description import Rig
from ...model.rig.noise_by_name import NoiseByName, by_name, covariance_of
from .graph import Graph

# Scale of a scene, whose unit is about that of the robot.
OPEN_SCALE_SD = 0.1


@dataclass(frozen=True, eq=False)
class RigNoise(ReadOnlyArrays):
    """Covariances of the measured poses of a `Graph`, and the effects of m errors that poses share; see its indices.

    Each shared error has the standard deviation 1 and moves the poses of one side.
    """

    robot: Array  # (P, 6, 6)
    camera: Array  # (E, 6, 6)
    by_robot: Array  # (P, 6, m_r) effects of the errors of the robot side
    by_camera: Array  # (E, 6, m_c)
    of_robot: NDArray[np.bool_]  # (m,) whether an error is one of the robot side
    keys: tuple[ErrorKey, ...] = ()  # of the m
    split_known: bool = True  # how the noise of rotations is split between robot and cameras (`fit`)

    @classmethod
    def of_own(cls, robot: Array, camera: Array) -> RigNoise:
        """Build noise that no two poses share."""
        none = np.zeros(0, dtype=bool)
        return cls(robot, camera, np.zeros((len(robot), 6, 0)), np.zeros((len(camera), 6, 0)), none)

    @property
    def count(self) -> int:
        """Number of shared errors m."""
        return len(self.of_robot)

    @property
    def K_robot(self) -> Array:
        """(P, 6, m) effects of all errors on the robot poses."""
        K = np.zeros((*self.by_robot.shape[:2], self.count))
        K[..., self.of_robot] = self.by_robot
        return K

    @property
    def K_camera(self) -> Array:
        """(E, 6, m) effects of all errors on the camera poses."""
        K = np.zeros((*self.by_camera.shape[:2], self.count))
        K[..., ~self.of_robot] = self.by_camera
        return K

    def moves(self, z: Array) -> tuple[Array, Array]:
        """Moves of the robot poses (P, 6) and the camera poses (E, 6) by errors z (m,)."""
        parts = ((self.by_robot, z[self.of_robot]), (self.by_camera, z[~self.of_robot]))
        robot, camera = ((K.reshape(6 * len(K), len(of)) @ of).reshape(len(K), 6) for K, of in parts)
        return robot, camera

    def with_blocks(self, terms: Iterable[ErrorTerm]) -> RigNoise:
        """Return the noise with what error terms add to each pose by itself, at the medians of their sizes."""
        own = {"robot": self.robot.copy(), "camera": self.camera.copy()}
        for term in terms:
            if term.block is not None:
                own[term.side] += term.size.median**2 * (term.block @ term.block.mT)
        return replace(self, robot=own["robot"], camera=own["camera"])

    def with_columns(self, terms: Iterable[ErrorTerm]) -> RigNoise:
        """Return the noise with the columns of further error terms, at the medians of their sizes."""
        shared = [term for term in terms if term.columns is not None]
        by = {"robot": self.by_robot, "camera": self.by_camera}
        for side, K in by.items():
            of_side = [term for term in shared if term.side == side]
            sizes = [np.ones(K.shape[-1]), *(np.full(term.count, term.size.median) for term in of_side)]
            by[side] = np.concatenate(
                [K, *(some_rows(term.columns, slice(None)) for term in of_side if term.columns is not None)], axis=-1
            )
            by[side] *= np.concatenate(sizes)
        of_robot = np.concatenate([self.of_robot, *(np.full(term.count, term.side == "robot") for term in shared)])
        keys = (*self.keys, *(key for term in shared for key in term.keys))
        return replace(self, by_robot=by["robot"], by_camera=by["camera"], of_robot=of_robot, keys=keys)

    def in_order(self, keys: tuple[ErrorKey, ...]) -> RigNoise:
        """Return the noise with columns for ``keys``, which contain all its own; 0 for those that it does not have."""
        place = {key: k for k, key in enumerate(keys)}
        at = np.array([place[key] for key in self.keys], dtype=np.intp)
        of_robot = np.zeros(len(keys), dtype=bool)
        of_robot[at] = self.of_robot
        robot, camera = (np.zeros((*K.shape[:2], len(keys))) for K in (self.by_robot, self.by_camera))
        robot[..., at[self.of_robot]], camera[..., at[~self.of_robot]] = self.by_robot, self.by_camera
        return replace(
            self, by_robot=robot[..., of_robot], by_camera=camera[..., ~of_robot], of_robot=of_robot, keys=keys
        )


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
    parts = [*calibrated_intrinsics(rig, graph).values(), *scene_components(rig, graph), *chains]
    return RigNoise.of_own(robot, camera).with_columns(part for part in parts if part.key.of("") != SCENE_EXCESS)


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
        sizes = {
            view.intrinsics.shape[-1]
            for view in rig.views
            if view.camera == name and view.intrinsics is not None and not view.scene
        }
        if not sizes:
            continue
        if len(sizes) > 1:
            raise InputError(f"Expected as many errors of intrinsics in all views of {name!r}, got {sorted(sizes)}.")
        columns = np.zeros((graph.E, 6, sizes.pop()))
        for k, view in enumerate(rig.views):
            if view.camera == name and view.intrinsics is not None and not view.scene:
                of = graph.view == k
                columns[of] = view.intrinsics[graph.row[of]]
        found[name] = ErrorTerm(INTRINSICS.of(name), "camera", Size(1.0), columns=columns)
    return found


def scene_components(rig: Rig, graph: Graph) -> list[ErrorTerm]:
    """Errors of the views of a scene: those that all of them share, those beyond its features, and its open scale."""
    found = []
    for name in rig.targets:
        views = {k: view for k, view in enumerate(rig.views) if view.target == name and view.scene}
        if not views:
            continue
        (count,) = {0 if view.intrinsics is None else view.intrinsics.shape[-1] for view in views.values()}
        columns, block = np.zeros((graph.E, 6, count)), np.zeros((graph.E, 6, 6))
        for k, view in views.items():
            of = graph.view == k
            assert view.covariance is not None
            block[of] = np.linalg.cholesky(view.covariance)[graph.row[of]]
            if view.intrinsics is not None:
                columns[of] = view.intrinsics[graph.row[of]]
        seen = np.isin(graph.view, list(views))[:, None, None]
        scale = np.pad(graph.C[:, :3, 3:], [(0, 0), (3, 0), (0, 0)]) * seen
        excess = SIZES[SCENE_EXCESS]
        found += [
            ErrorTerm(SCENE_FEATURES.of(name), "camera", Size(1.0), columns=columns),
            ErrorTerm(SCENE_EXCESS.of(name), "camera", excess, columns, block),
            ErrorTerm(TARGET_SCALE.of(name), "camera", Size(OPEN_SCALE_SD), columns=scale),
        ]
    return found


def kinematic_components(rig: Rig, graph: Graph, name: str) -> list[ErrorTerm]:
    """Errors of the chain of an arm by group, as of one camera (`KinematicErrors.terms`), and the joint noise."""
    arm, of = rig.arms[name], graph.arm == list(rig.arms).index(name)
    assert arm.kinematics is not None and arm.joints is not None
    terms = arm.errors.terms(arm.kinematics, arm.joints[graph.pose[of]], None, arm.by_poses)
    return [of_owner(part, of, name) for part in terms]


def of_owner(part: ErrorTerm, of: NDArray[np.bool_], name: str) -> ErrorTerm:
    """Return a component of the poses of one owner as one of all poses of a side, 0 for the others."""
    values: dict[str, Any] = {}
    for what, own in (("columns", part.columns), ("block", part.block)):
        if own is not None:
            values[what] = rows = some_rows(own, slice(None))
            if not of.all():
                values[what] = np.zeros((len(of), *rows.shape[1:]))
                values[what][of] = rows
    return replace(part, key=part.key.of(name), keys=tuple(key.of(name) for key in part.keys), **values)


def given_key(side: str, name: str) -> ErrorKey:
    """Return the key of the whole noise of an arm or a camera, by its side."""
    return ErrorKey(Owner(side), Kind.GIVEN, name=name)
