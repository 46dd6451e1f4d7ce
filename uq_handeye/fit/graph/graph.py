r"""The graph of a rig: unknown poses, edges (views), residuals with derivatives, and groups of rows.

For a product ``T_1 ... T_n`` of poses with errors ``xi = (theta, tau)`` (left rotation, additive translation)

    xi_product = sum_i D_i xi_i,      D_i = [[R_<i, 0], [-R_<i [R_i s_i]x, R_<i]]                      (T18)

R_<i the rotation of the factors before i, s_i the translation of the product of those after it. With the two sides
``L = [B_a G_a] X C`` and ``Q = [B_b G_b] W`` of an edge,

    r = (log(R_L R_Q^T), t_L - t_Q),      dr = sum over L of D_i xi_i - sum over Q of D_i xi_i

which holds where r = 0. For the robot poses and bases of Q the lever ``R_i s_i`` is taken from the left side,
``t_L`` minus the origin of the factor's frame: the same where r = 0, and as `graph.constraint` has it for
eye-to-hand. Of one camera and one target, J and D are those of that module, its rows rotated by the robot pose for
eye-to-hand, which changes no estimate.

Rows of edges that share a measured robot pose form a group; groups are independent of each other. Those with as many
edges and robot poses are handled at once (`Batch`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array, block, inverse, logarithm, skew
from ...model.rig.description import WORLD, Rig

_EYE = np.eye(3)
# Views whose groups of rows are made, whitened and summed at once: what is made of them on the way stays in the cache.
VIEWS_TOGETHER = 1000
Index = NDArray[np.intp]


class Sides(NamedTuple):
    """Residuals of edges and their derivatives (E, 6, 6) by each pose of the edge; 0 for poses it does not have."""

    r: Array  # (E, 6)
    X: Array
    W: Array
    base: tuple[Array, Array]  # of the arm of the camera, of that of the target
    robot: tuple[Array, Array]
    camera: Array  # by the camera pose C

    def of(self, edges: Index) -> Sides:
        """Those of some of the edges."""
        base, robot = ((one[0][edges], one[1][edges]) for one in (self.base, self.robot))
        return Sides(self.r[edges], self.X[edges], self.W[edges], base, robot, self.camera[edges])

    def half_less(self, other: Sides) -> Sides:
        """Half of the difference of the derivatives by the unknowns from those of another one."""
        base = (0.5 * (self.base[0] - other.base[0]), 0.5 * (self.base[1] - other.base[1]))
        return self._replace(X=0.5 * (self.X - other.X), W=0.5 * (self.W - other.W), base=base)


class Batch(NamedTuple):
    """Groups of e edges and q robot poses each, of `VIEWS_TOGETHER` views at most."""

    edges: Index  # (b, e)
    robots: Index  # (b, q) numbers of measured robot poses
    local: tuple[Index, Index]  # (b, e) place among ``robots`` of the pose left and right; q: none


@dataclass(frozen=True, eq=False)
class Graph:
    """Edges of a rig by numbers."""

    names: tuple[str, ...]  # of the m unknown poses: cameras, targets, bases
    C: Array  # (E, 4, 4) measured camera poses
    robot: Array  # (P, 4, 4) measured robot poses that edges use
    X: Index  # (E,) number of the unknown of the camera
    W: Index  # (E,)
    base: tuple[Index, Index]  # (E,) number of the base left and right; m: none
    side: tuple[Index, Index]  # (E,) number of the robot pose left and right; P: none
    view: Index  # (E,) number of the view in the rig
    row: Index  # (E,) row in that view
    arm: Index  # (P,) number of the arm of each robot pose
    pose: Index  # (P,) row in that arm

    @classmethod
    def of(cls, rig: Rig) -> Graph:
        """Number the poses, views and unknowns of a rig; robot poses without a view are left out."""
        arms = list(rig.arms)
        names = (*rig.cameras, *rig.targets, *arms[1:])
        number = {name: k for k, name in enumerate(names)}
        rows = {name: {moment: k for k, moment in enumerate(arm.names)} for name, arm in rig.arms.items()}
        used: dict[tuple[int, int], int] = {}
        columns: dict[str, list[int]] = {name: [] for name in ("X", "W", "b0", "b1", "g0", "g1", "view", "row")}
        for v, view in enumerate(rig.views):
            places = rig.places(view)
            assert view.at is not None
            count = len(view.at)
            for moment in view.at:
                for s, place in enumerate(places):
                    if place != WORLD:
                        key = (arms.index(place), rows[place][moment])
                        columns[f"g{s}"].append(used.setdefault(key, len(used)))
            for s, place in enumerate(places):
                columns[f"b{s}"] += [number.get(place, len(names))] * count
                columns[f"g{s}"] += [-1] * count if place == WORLD else []
            for name, value in {"X": number[view.camera], "W": number[view.target], "view": v}.items():
                columns[name] += [value] * count
            columns["row"] += range(count)
        found = {name: np.array(values, dtype=np.intp) for name, values in columns.items()}
        keys = np.array(list(used), dtype=np.intp).reshape(-1, 2)
        robot = np.array([rig.arms[arms[a]].poses[k] for a, k in keys.tolist()]).reshape(-1, 4, 4)
        sides = tuple(np.where(found[f"g{s}"] < 0, len(keys), found[f"g{s}"]) for s in (0, 1))
        C = np.concatenate([view.poses for view in rig.views])
        return cls(
            names, C, robot, found["X"], found["W"], (found["b0"], found["b1"]), (sides[0], sides[1]), found["view"],
            found["row"], keys[:, 0], keys[:, 1],
        )  # fmt: skip

    @property
    def m(self) -> int:
        """Number of unknown poses."""
        return len(self.names)

    @property
    def p(self) -> int:
        """Number of unknowns."""
        return 6 * len(self.names)

    @property
    def E(self) -> int:
        """Number of edges."""
        return len(self.C)

    @property
    def P(self) -> int:
        """Number of measured robot poses."""
        return len(self.robot)

    def used_by(self, edges: Index) -> Index:
        """Numbers of the robot poses that some edges use."""
        used = np.unique(np.concatenate([side[edges] for side in self.side]))
        return used[used < self.P]

    def of_edges(self, kept: Index) -> Graph:
        """Return the graph of some of the edges, with the robot poses that they use."""
        used = self.used_by(kept)
        place = np.full(self.P + 1, len(used), dtype=np.intp)
        place[used] = np.arange(len(used))
        return Graph(
            self.names, self.C[kept], self.robot[used], self.X[kept], self.W[kept],
            (self.base[0][kept], self.base[1][kept]), (place[self.side[0][kept]], place[self.side[1][kept]]),
            self.view[kept], self.row[kept], self.arm[used], self.pose[used],
        )  # fmt: skip

    # ------------------------------------------------------------------------------------------- groups

    @cached_property
    def group(self) -> Index:
        """(E,) number of the group of each edge: edges with robot poses that edges connect."""
        left, right = self.side
        both = (left < self.P) & (right < self.P)
        of_pose, one = np.arange(self.P + 1), np.where(left < self.P, left, right)
        if both.any():
            from scipy.sparse import coo_array  # slow to import
            from scipy.sparse.csgraph import connected_components

            joined = coo_array((np.ones(both.sum()), (left[both], right[both])), shape=(self.P + 1, self.P + 1))
            of_pose = connected_components(joined, directed=False)[1].astype(np.intp)
        alone = self.P + 1 + np.arange(self.E)  # views that no robot pose enters
        return np.unique(np.where(one < self.P, of_pose[one], alone), return_inverse=True)[1].astype(np.intp)

    @cached_property
    def batches(self) -> tuple[Batch, ...]:
        """All groups, those of one size together."""
        one = np.minimum(*self.side)
        order = np.argsort(one, kind="stable")
        if self.P == self.E and np.array_equal(one[order], np.arange(self.P)):  # each view has its own robot pose
            local = [np.where(side[order] < self.P, 0, 1)[:, None] for side in self.side]
            return tuple(_in_parts(Batch(order[:, None], one[order][:, None], (local[0], local[1]))))
        order = np.argsort(self.group, kind="stable")
        cuts = np.flatnonzero(np.diff(self.group[order])) + 1
        by_size: dict[tuple[int, int], list[tuple[Index, Index]]] = {}
        for edges in np.split(order, cuts):
            robots = np.unique(np.concatenate([side[edges] for side in self.side]))
            robots = robots[robots < self.P]
            by_size.setdefault((len(edges), len(robots)), []).append((edges, robots))
        found = []
        for (_, q), members in sorted(by_size.items()):
            edges, robots = (np.array([of[k] for of in members], dtype=np.intp) for k in (0, 1))
            robots = robots.reshape(len(members), q)
            local = [self._local(side[edges], robots) for side in self.side]
            found += _in_parts(Batch(edges, robots, (local[0], local[1])))
        return tuple(found)

    def _local(self, numbers: Index, robots: Index) -> Index:
        q = robots.shape[1]
        if q == 0:
            return np.zeros_like(numbers)
        same = numbers[:, :, None] == robots[:, None, :]
        return np.asarray(np.where(same.any(axis=-1), same.argmax(axis=-1), q), dtype=np.intp)

    # ------------------------------------------------------------------------------------------- rows

    def products(self, at: Array, robot: Array | None = None, C: Array | None = None) -> tuple[Array, Array]:
        """L and Q (E, 4, 4) at the unknowns (m, 4, 4)."""
        robot, C = self.robot if robot is None else robot, self.C if C is None else C
        T, G = np.concatenate([at, np.eye(4)[None]]), np.concatenate([robot, np.eye(4)[None]])
        K = [T[base] @ G[side] for base, side in zip(self.base, self.side, strict=True)]
        return K[0] @ at[self.X] @ C, K[1] @ at[self.W]

    def seen(self, at: Array) -> Array:
        """Camera poses (E, 4, 4) that close all edges at the unknowns (m, 4, 4)."""
        L, Q = self.products(at, C=np.broadcast_to(np.eye(4), self.C.shape))
        return np.asarray(inverse(L) @ Q)

    def residuals(self, at: Array) -> Array:
        """(E, 6) of r at the unknowns (m, 4, 4) and the measured poses."""
        L, Q = self.products(at)
        return np.concatenate([logarithm(L[:, :3, :3] @ Q[:, :3, :3].mT), L[:, :3, 3] - Q[:, :3, 3]], axis=-1)

    def linearise(
        self, at: Array, robot: Array | None = None, C: Array | None = None, edges: Index | slice = slice(None)
    ) -> Sides:
        """r and its derivatives at the unknowns (m, 4, 4) and the (measured or corrected) poses, of some edges or all.

        Parameters
        ----------
        at : (m, 4, 4)
        robot : (P, 4, 4)
        C : (E, 4, 4)
        """
        robot, C = self.robot if robot is None else robot, (self.C if C is None else C)[edges]
        T, G = np.concatenate([at, np.eye(4)[None]]), np.concatenate([robot, np.eye(4)[None]])
        bases, sides = ([one[edges] for one in both] for both in (self.base, self.side))
        B = [T[base] for base in bases]
        K = [b @ G[side] for b, side in zip(B, sides, strict=True)]
        X, W = at[self.X[edges]], at[self.W[edges]]
        arm = X[:, :3, :3] @ C[:, :3, 3:]  # R_X t_C
        lever = arm + X[:, :3, 3:]
        R_K = K[0][:, :3, :3]
        turned = R_K @ X[:, :3, :3]
        t_L = R_K @ lever + K[0][:, :3, 3:]
        Q = K[1] @ W
        r = np.empty((len(C), 6))
        r[:, :3] = logarithm(turned @ C[:, :3, :3] @ Q[:, :3, :3].mT)
        r[:, 3:] = (t_L - Q[:, :3, 3:])[..., 0]
        R_Q = K[1][:, :3, :3]
        nothing = np.broadcast_to(0.0, (len(C), 6, 6))
        by_base, by_robot = [], []
        for k, (b, base, side) in enumerate(zip(B, bases, sides, strict=True)):
            R_B = b[:, :3, :3]
            sign = np.where(side < self.P, -1.0 if k else 1.0, 0.0)[:, None, None]
            if sign.any():
                within = R_B.mT @ (t_L - b[:, :3, 3:]) - G[side][:, :3, 3:]  # from the flange's origin, in the base
                by_robot.append(sign * block(R_B, 0.0, -R_B @ skew(within[..., 0]), R_B))
            else:
                by_robot.append(nothing)
            sign = np.where(base < self.m, -1.0 if k else 1.0, 0.0)[:, None, None]
            by_base.append(
                sign * block(_EYE, 0.0, -skew((t_L - b[:, :3, 3:])[..., 0]), _EYE) if sign.any() else nothing
            )
        return Sides(
            r,
            block(R_K, 0.0, -R_K @ skew(arm[..., 0]), R_K),
            -block(R_Q, 0.0, 0.0, R_Q),
            (by_base[0], by_base[1]),
            (by_robot[0], by_robot[1]),
            block(turned, 0.0, 0.0, turned),
        )

    def _by_number(self, sides: Sides, edges: Index | slice) -> list[tuple[Index, Array]]:
        """Number of the unknown and derivative by it, of camera, target and the bases that some edges have."""
        listed = [(self.X, sides.X), (self.W, sides.W), *zip(self.base, sides.base, strict=True)]
        return [(number[edges], D) for number, D in listed if not _is_nothing(D)]

    def by_unknowns(self, sides: Sides, edges: Index | slice = slice(None)) -> Array:
        """J (n, 6, p) of some edges, whose derivatives ``sides`` are, or of all."""
        n = len(sides.r)
        J, edge = np.zeros((n, 6, self.m + 1, 6)), np.arange(n)
        for number, D in self._by_number(sides, edges):
            J[edge, :, number] += D
        return J[:, :, :-1].reshape(n, 6, self.p)

    def moved(self, sides: Sides, x: Array, edges: Index | slice = slice(None)) -> Array:
        """(n, 6) of ``J x``, without forming J."""
        steps = np.append(x, np.zeros(6)).reshape(-1, 6, 1)
        found = np.zeros_like(sides.r)
        for number, D in self._by_number(sides, edges):
            found += (D @ steps[number])[..., 0]
        return found

    @cached_property
    def kinds(self) -> tuple[tuple[Index, Index], ...]:
        """Edges that depend on the same unknowns, and the numbers (4,) of these: X, W, both bases; m: none."""
        numbers = np.stack([self.X, self.W, *self.base], axis=-1)
        found, kind = np.unique(numbers, axis=0, return_inverse=True)
        return tuple((np.flatnonzero(kind.reshape(-1) == k), one) for k, one in enumerate(found))

    def gram(self, sides: Sides, weights: Array) -> Array:
        """(p, p) of ``J^T diag(weights) J``, weights (E, 6), without forming J."""
        whole = np.zeros((self.m + 1, self.m + 1, 6, 6))
        root = np.sqrt(weights)[..., None]
        for edges, numbers in self.kinds:
            has = numbers < self.m
            D = np.concatenate([one[edges] for one, is_it in zip((sides.X, sides.W, *sides.base), has, strict=True)
                                if is_it], axis=-1)  # fmt: skip
            flat = (root[edges] * D).reshape(-1, D.shape[-1])
            blocks = (flat.T @ flat).reshape(has.sum(), 6, has.sum(), 6).transpose(0, 2, 1, 3)
            np.add.at(whole, (numbers[has][:, None], numbers[has][None]), blocks)
        return whole[:-1, :-1].transpose(0, 2, 1, 3).reshape(self.p, self.p)

    def by_robots(self, batch: Batch, sides: Sides) -> Array:
        """(b, 6e, 6q) derivatives of the rows of each group by its robot poses; ``sides`` of the edges of the batch."""
        (b, e), q = batch.edges.shape, batch.robots.shape[1]
        D = np.zeros((b, e, 6, q + 1, 6))
        group, place = np.arange(b)[:, None], np.arange(e)[None]
        for local, by_robot in zip(batch.local, sides.robot, strict=True):
            if not _is_nothing(by_robot):
                D[group, place, :, local] += by_robot.reshape(b, e, 6, 6)
        return D[..., :q, :].reshape(b, 6 * e, 6 * q)


def _is_nothing(D: Array) -> bool:
    """Return whether derivatives are one zero for all edges, which has no memory of its own."""
    return D.strides == (0, 0, 0)


def _in_parts(batch: Batch) -> list[Batch]:
    """Return the groups of a batch in parts of `VIEWS_TOGETHER`."""
    count = max(1, VIEWS_TOGETHER // batch.edges.shape[1])
    parts = (slice(start, start + count) for start in range(0, len(batch.edges), count))
    left, right = batch.local
    return [Batch(batch.edges[of], batch.robots[of], (left[of], right[of])) for of in parts]


def noise_of_robots(D: Array, S: Array) -> Array:
    """(b, 6e, 6e) sum of ``D_k S_k D_k^T`` over the q robot poses of a group; D (b, 6e, 6q), S (b, q, 6, 6)."""
    total = np.zeros((len(D), D.shape[1], D.shape[1]))
    for k in range(S.shape[1]):
        D_k = D[..., 6 * k : 6 * k + 6]
        total += D_k @ S[:, k] @ D_k.mT
    return total


def noise_of_cameras(D: Array, S: Array) -> Array:
    """(b, 6e, 6e) block diagonal of ``D_k S_k D_k^T`` of the e views of a group; D and S (b, e, 6, 6)."""
    b, e = D.shape[:2]
    found, blocks = np.zeros((b, e, 6, e, 6)), D @ S @ D.mT
    for k in range(e):
        found[:, k, :, k] = blocks[:, k]
    return found.reshape(b, 6 * e, 6 * e)
