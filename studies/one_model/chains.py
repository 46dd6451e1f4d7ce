"""Nominal arms: tables of joints from makers' data sheets, forward and inverse kinematics, URDF text.

Model: with the fixed transforms O_k = (xyz, rpy) and the rotations M_k(q_k) about the axis of joint k,

    base_T_flange = O_1 M_1(q_1) O_2 M_2(q_2) .. O_L M_L(q_L) O_flange

Lengths are in m, angles in rad. The z axis of the flange points away from the arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Row = tuple[tuple[float, float, float], tuple[float, float, float], tuple[int, int, int], tuple[float, float]]
Origin = tuple[tuple[float, float, float], tuple[float, float, float]]

HALF = np.pi / 2
NONE = (0.0, 0.0, 0.0)
X_AXIS, Y_AXIS, Z_AXIS = (1, 0, 0), (0, 1, 0), (0, 0, 1)
MOST = np.pi  # rad; joints that may turn further are used as far as this


def _ur(d1: float, a2: float, a3: float, d4: float, d5: float, d6: float) -> tuple[list[Row], Origin]:
    """Return the rows of a Universal Robots arm by its DH parameters."""
    limits = (-2 * np.pi, 2 * np.pi)
    rows: list[Row] = [
        (NONE, NONE, Z_AXIS, limits),
        ((0.0, 0.0, d1), (HALF, 0.0, 0.0), Z_AXIS, limits),
        ((a2, 0.0, 0.0), NONE, Z_AXIS, (-np.pi, np.pi)),
        ((a3, 0.0, 0.0), NONE, Z_AXIS, limits),
        ((0.0, 0.0, d4), (HALF, 0.0, 0.0), Z_AXIS, limits),
        ((0.0, 0.0, d5), (-HALF, 0.0, 0.0), Z_AXIS, limits),
    ]
    return rows, ((0.0, 0.0, d6), NONE)


def _deg(low: float, high: float | None = None) -> tuple[float, float]:
    """Return limits in rad; one number is both, either way."""
    return (-np.radians(low), np.radians(low)) if high is None else (np.radians(low), np.radians(high))


def _negative(axis: tuple[int, int, int]) -> tuple[int, int, int]:
    return (-axis[0], -axis[1], -axis[2])


OUTWARD: Origin = (NONE, (0.0, HALF, 0.0))  # flange of arms whose last joint turns about x
# Joints, flange, posture in which the flange looks down.
_TABLES: dict[str, tuple[tuple[list[Row], Origin], tuple[float, ...]]] = {
    # Universal Robots, DH parameters of UR5 and UR10e.
    "ur5": (_ur(0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823), (0.0, -1.8, 1.9, -1.67, -1.57, 0.0)),
    "ur10e": (_ur(0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655), (0.0, -1.8, 1.9, -1.67, -1.57, 0.0)),
    # ABB IRB 120-3/0.6, product specification 3HAC035960.
    "irb120": (
        (
            [
                (NONE, NONE, Z_AXIS, _deg(165)),
                ((0.0, 0.0, 0.29), NONE, Y_AXIS, _deg(110)),
                ((0.0, 0.0, 0.27), NONE, Y_AXIS, _deg(-110, 70)),
                ((0.0, 0.0, 0.07), NONE, X_AXIS, _deg(160)),
                ((0.302, 0.0, 0.0), NONE, Y_AXIS, _deg(120)),
                ((0.072, 0.0, 0.0), NONE, X_AXIS, _deg(400)),
            ],
            OUTWARD,
        ),
        (0.0, 0.3, 0.1, 0.0, 1.1, 0.0),
    ),
    # KUKA KR 6 R900 sixx.
    "kr6_r900": (
        (
            [
                ((0.0, 0.0, 0.4), NONE, _negative(Z_AXIS), _deg(170)),
                ((0.025, 0.0, 0.0), NONE, Y_AXIS, _deg(-190, 45)),
                ((0.455, 0.0, 0.0), NONE, Y_AXIS, _deg(-120, 156)),
                ((0.0, 0.0, 0.035), NONE, _negative(X_AXIS), _deg(185)),
                ((0.42, 0.0, 0.0), NONE, Y_AXIS, _deg(120)),
                ((0.08, 0.0, 0.0), NONE, _negative(X_AXIS), _deg(350)),
            ],
            OUTWARD,
        ),
        (0.0, -1.5, 1.5, 0.0, 1.4, 0.0),
    ),
    # FANUC LR Mate 200iD.
    "lrmate200id": (
        (
            [
                ((0.0, 0.0, 0.33), NONE, Z_AXIS, _deg(170)),
                ((0.05, 0.0, 0.0), NONE, Y_AXIS, _deg(-100, 145)),
                ((0.0, 0.0, 0.33), NONE, _negative(Y_AXIS), _deg(-70, 205)),
                ((0.0, 0.0, 0.035), NONE, _negative(X_AXIS), _deg(190)),
                ((0.335, 0.0, 0.0), NONE, _negative(Y_AXIS), _deg(125)),
                ((0.08, 0.0, 0.0), NONE, _negative(X_AXIS), _deg(360)),
            ],
            OUTWARD,
        ),
        (0.0, 0.2, 0.0, 0.0, -1.3, 0.0),
    ),
    # Franka Emika Panda, DH parameters (Craig's) of its documentation.
    "panda": (
        (
            [
                ((0.0, 0.0, 0.333), NONE, Z_AXIS, (-2.8973, 2.8973)),
                (NONE, (-HALF, 0.0, 0.0), Z_AXIS, (-1.7628, 1.7628)),
                ((0.0, -0.316, 0.0), (HALF, 0.0, 0.0), Z_AXIS, (-2.8973, 2.8973)),
                ((0.0825, 0.0, 0.0), (HALF, 0.0, 0.0), Z_AXIS, (-3.0718, -0.0698)),
                ((-0.0825, 0.384, 0.0), (-HALF, 0.0, 0.0), Z_AXIS, (-2.8973, 2.8973)),
                (NONE, (HALF, 0.0, 0.0), Z_AXIS, (-0.0175, 3.7525)),
                ((0.088, 0.0, 0.0), (HALF, 0.0, 0.0), Z_AXIS, (-2.8973, 2.8973)),
            ],
            ((0.0, 0.0, 0.107), NONE),
        ),
        (0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8),
    ),
    # KUKA LBR iiwa 14 R820.
    "iiwa14": (
        (
            [
                ((0.0, 0.0, 0.1575), NONE, Z_AXIS, _deg(170)),
                ((0.0, 0.0, 0.2025), NONE, Y_AXIS, _deg(120)),
                ((0.0, 0.0, 0.2045), NONE, Z_AXIS, _deg(170)),
                ((0.0, 0.0, 0.2155), NONE, _negative(Y_AXIS), _deg(120)),
                ((0.0, 0.0, 0.1845), NONE, Z_AXIS, _deg(170)),
                ((0.0, 0.0, 0.2155), NONE, Y_AXIS, _deg(120)),
                ((0.0, 0.0, 0.081), NONE, Z_AXIS, _deg(175)),
            ],
            ((0.0, 0.0, 0.045), NONE),
        ),
        (0.0, 0.5, 0.0, -1.4, 0.0, 1.2, 0.0),
    ),
}
ARMS = tuple(_TABLES)
SIX_AXES = tuple(name for name, (table, _) in _TABLES.items() if len(table[0]) == 6)


@dataclass(frozen=True, eq=False)
class Chain:
    """Nominal arm of L revolute joints."""

    name: str
    rows: tuple[Row, ...]
    end: Origin
    home: Array  # (L,) rad: the flange looks down
    origins: tuple[Array, ...]  # L times (4, 4)
    flange: Array  # (4, 4)
    axes: Array  # (L, 3)
    limits: Array  # (L, 2) rad

    @property
    def n_joints(self) -> int:
        return len(self.rows)

    @property
    def range(self) -> Array:
        """(L, 2) rad: limits, at most half a turn either way."""
        return np.clip(self.limits, -MOST, MOST)

    def poses(self, q: Array) -> Array:
        """Return the nominal base_T_flange (n, 4, 4)."""
        return frames(self, q)[2]

    def workspace(self, n: int, rng: np.random.Generator) -> Array:
        """Draw joints (n, L) uniformly between the limits, the flange above the floor."""
        low, high = self.range.T
        q = rng.uniform(low, high, (4 * n, self.n_joints))
        q = q[self.poses(q)[:, 2, 3] > 0.0]
        return q[:n] if len(q) >= n else np.concatenate([q, self.workspace(n - len(q), rng)])


@cache
def chain(name: str) -> Chain:
    """Return one of `ARMS`."""
    (rows, end), home = _TABLES[name]
    return Chain(
        name,
        tuple(rows),
        end,
        np.array(home),
        tuple(transform(xyz, rpy) for xyz, rpy, _, _ in rows),
        transform(*end),
        np.array([axis for _, _, axis, _ in rows], dtype=float),
        np.array([limits for *_, limits in rows]),
    )


def transform(xyz: Any, rpy: Any) -> Array:
    """Return the origin of a joint: position and fixed-axis roll, pitch, yaw, as in a URDF."""
    r, p, y = rpy
    T = np.eye(4)
    T[:3, :3] = turn(np.array([0.0, 0.0, 1.0]), y) @ turn(np.array([0.0, 1.0, 0.0]), p) @ turn(np.array([1.0, 0, 0]), r)
    T[:3, 3] = xyz
    return T


def cross_matrix(v: Array) -> Array:
    """[v]x (..., 3, 3)."""
    M = np.zeros((*v.shape[:-1], 3, 3))
    M[..., 0, 1], M[..., 0, 2], M[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    M[..., 1, 0], M[..., 2, 0], M[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return M


def turn(axis: Array, angle: Any) -> Array:
    """Return rotations (..., 3, 3) by angles about one unit vector."""
    K = cross_matrix(axis)
    angle = np.asarray(angle)[..., None, None]
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K))


def frames(of: Chain, q: Array, origins: Any = None, flange: Array | None = None) -> tuple[Array, Array, Array]:
    """Return axes (n, L, 3) and positions (n, L, 3) of the joints in the base, and base_T_flange (n, 4, 4).

    ``origins`` and ``flange`` replace the nominal ones.
    """
    n, L = q.shape
    R, p = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
    z, at = np.empty((n, L, 3)), np.empty((n, L, 3))
    sin, cos = np.sin(q)[..., None, None], np.cos(q)[..., None, None]
    for k, origin in enumerate(of.origins if origins is None else origins):
        K = cross_matrix(of.axes[k])
        turned, still = origin[:3, :3] @ K, origin[:3, :3] @ (np.eye(3) + K @ K)
        p = p + R @ origin[:3, 3]
        R = R @ (still + sin[:, k] * turned - cos[:, k] * (turned @ K))
        z[:, k], at[:, k] = R @ of.axes[k], p
    last = of.flange if flange is None else flange
    T = np.zeros((n, 4, 4))
    T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = R @ last[:3, :3], p + R @ last[:3, 3], 1.0
    return z, at, T


def branch(of: Chain, q: Array) -> Array:
    """Return the signs (n, 3) of shoulder, elbow and wrist; of seven axes nothing, (n, 0)."""
    if of.n_joints != 6:
        return np.zeros((len(q), 0))
    z, at, T = frames(of, q)
    J = np.concatenate([z, np.cross(z, T[:, None, :3, 3] - at)], axis=-1)
    elbow = np.sum(z[:, 2] * np.cross(at[:, 2] - at[:, 1], at[:, 4] - at[:, 2]), axis=-1)
    wrist = np.sum(z[:, 4] * np.cross(z[:, 3], z[:, 5]), axis=-1)
    return np.asarray(np.sign(np.stack([np.linalg.det(J) * elbow * wrist, elbow, wrist], axis=-1)))


def inverse_kinematics(of: Chain, wanted: Array, start: Array, steps: int = 25) -> tuple[Array, NDArray[np.bool_]]:
    """Return joints (n, L), from ``start`` (n, L) on, and which of them reach ``wanted`` within the limits.

    Damped least squares on position and rotation; what does not converge in ``steps`` has no solution.
    """
    q = np.array(start)
    reached = np.zeros(len(q), dtype=bool)
    left = np.arange(len(q))
    for _ in range(steps):
        z, at, T = frames(of, q[left])
        turned = T[:, :3, :3].mT @ wanted[left, :3, :3]
        skew = turned - turned.mT
        w = 0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
        cos = 0.5 * (np.trace(turned, axis1=1, axis2=2) - 1.0)
        size = np.linalg.norm(w, axis=-1)
        angle = np.arctan2(size, cos)
        w *= np.where(size > 1e-6, angle / np.maximum(size, 1e-12), 1.0)[:, None]
        e = np.concatenate([(T[:, :3, :3] @ w[..., None])[..., 0], wanted[left, :3, 3] - T[:, :3, 3]], axis=-1)
        done = np.abs(e).max(axis=-1) < 1e-9
        reached[left[done]] = True
        left, e, z, at, T = left[~done], e[~done], z[~done], at[~done], T[~done]
        if not len(left):
            break
        J = np.concatenate([z, np.cross(z, T[:, None, :3, 3] - at)], axis=-1).mT
        step = (J.mT @ np.linalg.solve(J @ J.mT + 1e-7 * np.eye(6), e[..., None]))[..., 0]
        q[left] += np.clip(step, -0.4, 0.4)
    low, high = of.limits.T
    return q, reached & ((q > low) & (q < high)).all(axis=-1)


def urdf(of: Chain) -> str:
    """Return the URDF text of the nominal chain, from ``base_link`` to ``flange``."""

    def numbers(values: Any) -> str:
        return " ".join(repr(float(value)) for value in values)

    links = ["base_link", *(f"link_{k + 1}" for k in range(of.n_joints)), "flange"]
    lines = [f'<robot name="{of.name}">', *(f'  <link name="{link}"/>' for link in links)]
    for k, (xyz, rpy, axis, limits) in enumerate(of.rows):
        lines += [
            f'  <joint name="joint_{k + 1}" type="revolute">',
            f'    <parent link="{links[k]}"/><child link="{links[k + 1]}"/>',
            f'    <origin xyz="{numbers(xyz)}" rpy="{numbers(rpy)}"/><axis xyz="{numbers(axis)}"/>',
            f'    <limit lower="{limits[0]!r}" upper="{limits[1]!r}" effort="100" velocity="2"/>',
            "  </joint>",
        ]
    lines += [
        '  <joint name="to_flange" type="fixed">',
        f'    <parent link="{links[-2]}"/><child link="flange"/>',
        f'    <origin xyz="{numbers(of.end[0])}" rpy="{numbers(of.end[1])}"/>',
        "  </joint>",
        "</robot>",
    ]
    return "\n".join(line.replace("np.float64(", "").replace(")", "") for line in lines) + "\n"
