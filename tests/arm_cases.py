"""Arms for tests: URDF texts, random chains, and the kinematics once more, factor by factor, slowly."""

import numpy as np
from scipy.spatial.transform import Rotation

from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.model.kinematics.chain import Joint, Kinematics
from uq_handeye.model.poses.pose_pairs import PosePairs

# A six-axis arm of 0.9 m with axes along x, y and z, and frames before and behind it.
SIX_AXES = """<?xml version="1.0"?>
<robot name="six_axes">
  <link name="base_link"/> <link name="base"/> <link name="l1"/> <link name="l2"/> <link name="l3"/> <link name="l4"/>
  <link name="l5"/> <link name="l6"/> <link name="flange"/> <link name="tool0"/>
  <joint name="to_base" type="fixed">
    <parent link="base_link"/> <child link="base"/> <origin rpy="0 0 3.141592653589793"/>
  </joint>
  <joint name="axis_1" type="revolute">
    <parent link="base_link"/> <child link="l1"/> <origin xyz="0 0 0.29"/> <axis xyz="0 0 1"/>
    <limit lower="-2.9" upper="2.9" effort="0" velocity="0"/>
  </joint>
  <joint name="axis_2" type="revolute">
    <parent link="l1"/> <child link="l2"/> <origin xyz="0.02 0 0"/> <axis xyz="0 1 0"/>
    <limit lower="-1.9" upper="1.9"/>
  </joint>
  <joint name="axis_3" type="revolute">
    <parent link="l2"/> <child link="l3"/> <origin xyz="0 0 0.27"/> <axis xyz="0 2 0"/>
    <limit lower="-1.9" upper="1.2"/>
  </joint>
  <joint name="axis_4" type="revolute">
    <parent link="l3"/> <child link="l4"/> <origin xyz="0 0 0.07" rpy="0.1 0 0.2"/>
    <limit lower="-2.7" upper="2.7"/>
  </joint>
  <joint name="axis_5" type="revolute">
    <parent link="l4"/> <child link="l5"/> <origin xyz="0.302 0 0"/> <axis xyz="0 -1 0"/>
    <limit lower="-2.0" upper="2.0"/>
  </joint>
  <joint name="axis_6" type="continuous"> <parent link="l5"/> <child link="l6"/> <axis xyz="1 0 0"/> </joint>
  <joint name="to_flange" type="fixed">
    <parent link="l6"/> <child link="flange"/> <origin xyz="0.072 0 0" rpy="0 1.5707963267948966 0"/>
  </joint>
  <joint name="to_tool0" type="fixed"> <parent link="flange"/> <child link="tool0"/> </joint>
</robot>
"""


def random_chain(rng, kinds):
    """Joints of these kinds (R, P) with random origins and axes."""
    joints = []
    for k, kind in enumerate(kinds):
        joints.append(
            Joint(
                f"j{k}",
                {"R": "revolute", "P": "prismatic"}[kind],
                random_transform(rng),
                rng.normal(size=3),
                *((-2.5, 2.0) if kind == "R" else (-0.3, 0.4)),
            )
        )
    return Kinematics("random", "base", "tip", tuple(joints), random_transform(rng))


def random_transform(rng):
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()
    T[:3, 3] = rng.normal(size=3) * 0.3
    return T


def motion(rotation=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rotation).as_matrix()
    T[:3, 3] = shift
    return T


def generator(rotation=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)):
    x, y, z = rotation
    G = np.zeros((4, 4))
    G[:3, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    G[:3, 3] = shift
    return G


def to_axis(joint):
    """The smallest rotation of z to the axis, by its rotation vector."""
    z = np.array([0.0, 0.0, 1.0])
    normal = np.cross(z, joint.axis)
    sine = np.linalg.norm(normal)
    if sine < 1e-12:
        return np.eye(4) if joint.axis[2] > 0 else motion((np.pi, 0.0, 0.0))
    return motion(normal / sine * np.arctan2(sine, joint.axis[2]))


def factors(chain, q):
    """The factors of T(q) of one posture, and their derivatives by their joints and geometric errors.

    Yields name, matrix, and a list of (what, derivative matrix).
    """
    for joint, value in zip(chain.joints, q, strict=True):
        A = to_axis(joint)
        turn = joint.kind == "revolute"
        axes = np.eye(3)
        by = [(("turn", joint.name, i), A @ generator(rotation=axes[i]) @ A.T) for i in range(3)]
        by += [(("shift", joint.name, i), A @ generator(shift=axes[i]) @ A.T) for i in range(3)]
        yield joint.origin, []
        yield np.eye(4), by
        M = motion(joint.axis * value) if turn else motion(shift=joint.axis * value)
        G = generator(rotation=joint.axis) if turn else generator(shift=joint.axis)
        yield M, [(("joint", joint.name, 0), M @ G)]
    yield chain.end, []


def pose_and_twists(chain, q):
    """T of one posture and, by the product rule, the twist by each joint and geometric error."""
    parts = list(factors(chain, q))
    T = np.linalg.multi_dot([M for M, _ in parts])
    found = {}
    for k, (_, derivatives) in enumerate(parts):
        for what, D in derivatives:
            product = np.eye(4)
            for i, (M, _) in enumerate(parts):
                product = product @ (D if i == k else M)
            W = product[:3, :3] @ T[:3, :3].T
            found[what] = np.array([W[2, 1], W[0, 2], W[1, 0], *product[:3, 3]])
    return T, found


def twist_between(T, S):
    """(theta, tau) from T to S: left rotation, additive translation."""
    theta = Rotation.from_matrix(S[..., :3, :3] @ np.swapaxes(T[..., :3, :3], -1, -2))
    lead = T.shape[:-2]
    return np.concatenate([theta.as_rotvec().reshape(*lead, 3), S[..., :3, 3] - T[..., :3, 3]], axis=-1)


def measured(
    arm, rng, n=30, *, e=None, q=None, setup="eye-in-hand", near=None, joint_sd=0.0, camera=(0.0, 0.0), X=None, W=None
):
    """Pose pairs of an arm with errors e (m,), seen by a camera with noise (rad, m); and X and W.

    The robot poses are those of the nominal arm at the joints that it reports. ``near``: half width (rad) of the joint
    ranges about one posture; None: the whole of the limits that are finite.
    """
    if q is None:
        low, high = np.where(np.isfinite(arm.limits.T), arm.limits.T, np.array([[-3.0], [3.0]]))
        if near is not None:
            middle = 0.5 * (low + high) + 0.3
            low, high = np.maximum(low, middle - near), np.minimum(high, middle + near)
        q = rng.uniform(low, high, (n, arm.n_joints))
    X = transform([0.1, -0.2, 0.7], [0.04, -0.02, 0.11]) if X is None else X
    W = transform([0.2, 0.1, -0.4], [0.5, 0.1, -0.2]) if W is None else W
    true = arm.poses(q + joint_sd * rng.normal(size=q.shape), e)
    G = true if setup == "eye-in-hand" else np.linalg.inv(true)
    noise = rng.normal(size=(len(q), 6)) * np.repeat(camera, 3)
    seen = perturb(np.linalg.inv(X) @ np.linalg.inv(G) @ W, noise)
    return PosePairs(arm.poses(q), seen, setup, joints=q), X, W


def transform(rotation_vector, translation):
    """(4, 4)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(rotation_vector).as_matrix(), translation
    return T
