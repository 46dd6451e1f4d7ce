"""Real arms whose joints were recorded: predictions of camera poses that were held out."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import uq_handeye as uq
from studies.common.scores import errors
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.read import read_pose_file

TURN = 0.3  # m per rad: what a rotation counts where neighbours of a pose are looked for


class Recorded(NamedTuple):
    """One arm: its URDF, joints (n, L) and camera poses."""

    kinematics: uq.Kinematics
    q: Array
    camera: Array
    setup: str

    def poses(self, index: NDArray[np.intp]) -> uq.PosePairs:
        """Return the poses by the URDF."""
        q = self.q[index]
        return uq.PosePairs(self.kinematics.poses(q), self.camera[index], self.setup, joints=q)


def recorded(folder: Path, setup: str) -> Recorded:
    kinematics = uq.Kinematics.from_urdf(folder / "model.urdf")
    q = pd.read_csv(folder / "joints.csv")[list(kinematics.names)].to_numpy()
    return Recorded(kinematics, q, read_pose_file(folder / "camera.csv")[1], setup)


def subsets(
    of: Recorded, where: str, n: int, count: int, rng: np.random.Generator
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Rows to calibrate with and all others: the n nearest to a pose of the robot, or n anywhere."""
    G, every = of.kinematics.poses(of.q), np.arange(len(of.q))
    for centre in rng.permutation(len(every))[:count]:
        if where == "local":
            away = errors(G, np.broadcast_to(G[centre], G.shape)) * np.repeat([TURN, 1.0], 3)
            chosen = np.argsort(np.linalg.norm(away, axis=-1))[:n]
        else:
            chosen = rng.permutation(every)[:n]
        yield np.sort(chosen), np.setdiff1d(every, chosen)
