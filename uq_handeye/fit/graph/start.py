r"""A first guess of all poses, in closed form for one arm.

Rotations: with ``R_P R_C = R_Q`` for each edge, linear in the two unknown rotations of an edge where the bases are
known,

    (R_G (x) R_C^T) vec R_X - (R_H (x) I) vec R_W = 0          (vec row by row; G, H robot poses or I)

The eigenvector of the smallest eigenvalue of the sum over edges of A^T A (9 m square) holds all rotations in one frame,
each projected on SO(3). With several arms, whose bases are unknown, the edges have three or more unknown rotations:
each in turn is the one nearest to the predictions of the others, from many random starts at once, the best of which
counts. Then all translations, linear given the rotations, follow by least squares. Outlying rows, judged by the median,
are left out and the start is computed again. Starts from
a few random moments each are tried, too, and the one of the least median misfit counts (Rousseeuw 1984): wrong rows are
in few of them. One camera with one target starts as `calibrate` does (4DPA), and a rig about one axis from its best
pair along a spanning tree.

Parts of the graph that no view connects are reported first. Cameras and targets that see each
other, directly or through others, are one part. A part is connected to the world if one of its views leads from one
carrier to another (an arm to the world, an arm to another arm), or a pose in it is known. The base of an arm is
connected to another arm if a part has a camera or target on both.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from ...core.geometry.nearest_rotation import nearest_rotation
from ...core.geometry.se3 import Array, inverse
from ...core.limits import OUTLIER_MEDIANS
from ...errors import DegenerateMotionError, InputError
from ...model.poses.pose_pairs import PosePairs
from .constraint import OnPoses
from .graph import VIEWS_TOGETHER, Graph
from .starts import sound_start

# The linear problem determines the rotations where its second eigenvalue, relative to the mean, is above this.
MIN_ROTATION_GAP = 1e-4
# Views of each camera and target in a start from few moments.
MIN_VIEWS_OF_EACH = 4


def start_of(graph: Graph, seed: int = 0) -> tuple[Array, NDArray[np.bool_]]:
    """Return all poses (m, 4, 4), and the edges (E,) that they were computed from."""
    kept = np.ones(graph.E, dtype=bool)
    if graph.m == 2 and not _moves_twice(graph):
        with suppress(DegenerateMotionError):
            return _pair(graph, 0, 1), kept
    at = np.zeros((graph.m, 4, 4))
    for _ in range(4):
        some = graph if kept.all() else graph.of_edges(np.flatnonzero(kept))
        at = _solved(some, seed)
        again = agreeing(graph, at)
        if (again == kept).all() or not _all_seen(graph, again):
            break
        kept = again
    if any((base < graph.m).any() for base in graph.base):  # random starts by their median misfit already
        return at, kept
    return _consensus(graph, at, kept, seed)


def _consensus(graph: Graph, at: Array, kept: NDArray[np.bool_], seed: int) -> tuple[Array, NDArray[np.bool_]]:
    """Return the start of the least median misfit of that given and those from few moments, and the edges that agree.

    The misfit of a start is the product of its median residuals of rotation and of translation over those of the start
    given: wrong rows often spoil one of the two only. Another start is taken where its misfit is below half: from few
    right moments it is larger.
    """

    def sizes(T: Array) -> Array:
        return np.asarray(np.linalg.norm(graph.residuals(T).reshape(-1, 2, 3), axis=-1))

    rng, scale = np.random.default_rng(seed), np.maximum(np.median(sizes(at), axis=0), 1e-12)
    best, least = at, 0.5
    for _ in range(25):  # with three of ten moments wrong, one start is of right ones with probability 0.999
        some = _few_groups(graph, rng)
        if len(some) > graph.E // 2:  # many cameras and targets: as many wrong rows as in all
            break
        try:
            tried = _solved(graph.of_edges(some), seed)
        except (DegenerateMotionError, InputError):
            continue
        misfit = float(np.prod(np.median(sizes(tried), axis=0) / scale))
        if misfit < least:
            best, least = tried, misfit
    if best is at:
        return at, kept
    again = agreeing(graph, best)
    if not _all_seen(graph, again):
        return best, again
    at = _solved(graph.of_edges(np.flatnonzero(again)), seed)
    return at, agreeing(graph, at)


def _few_groups(graph: Graph, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return the edges of random groups until each camera and target has enough of them."""
    seen, chosen = np.zeros(graph.m, dtype=np.intp), np.zeros(graph.E, dtype=bool)
    wanted = np.unique(np.concatenate([graph.X, graph.W]))
    for group in rng.permutation(int(graph.group.max()) + 1).tolist():
        of = group == graph.group
        if (seen[np.concatenate([graph.X[of], graph.W[of]])] < MIN_VIEWS_OF_EACH).any():
            chosen |= of
            np.add.at(seen, np.concatenate([graph.X[of], graph.W[of]]), 1)
            if (seen[wanted] >= MIN_VIEWS_OF_EACH).all():
                break
    return np.flatnonzero(chosen)


def _all_seen(graph: Graph, kept: NDArray[np.bool_]) -> bool:
    return len(np.unique(np.concatenate([graph.X[kept], graph.W[kept]]))) == len(
        np.unique(np.concatenate([graph.X, graph.W]))
    )


def agreeing(graph: Graph, at: Array) -> NDArray[np.bool_]:
    """Return the edges whose residuals of rotation and of translation are not far above the median."""
    r = graph.residuals(at).reshape(-1, 2, 3)
    size = np.linalg.norm(r, axis=-1)
    median = np.maximum(np.median(size, axis=0), 1e-12)
    return np.asarray((size <= OUTLIER_MEDIANS * median).all(axis=-1))


def _moves_twice(graph: Graph) -> bool:
    """Return whether the edges of a pair have a robot pose on both sides, or none."""
    on = [(side < graph.P) for side in graph.side]
    return bool((on[0] & on[1]).any() or not (on[0] | on[1]).any())


def _pair(graph: Graph, X: int, W: int) -> Array:
    """All poses as they are, with those of one camera and one target as `calibrate` starts."""
    at = np.tile(np.eye(4), (graph.m, 1, 1))
    edges = np.flatnonzero((graph.X == X) & (graph.W == W))
    on_left = bool((graph.side[0][edges[0]] < graph.P).all())
    G = graph.robot[graph.side[0 if on_left else 1][edges]]
    data = PosePairs(G, graph.C[edges], "eye-in-hand" if on_left else "eye-to-hand")
    found = sound_start(data, OnPoses(data.robot, data.camera, not on_left), None)
    assert found.W is not None
    at[X], at[W] = found.X, found.W
    return at


def _solved(graph: Graph, seed: int) -> Array:
    has_base = any((base < graph.m).any() for base in graph.base)
    if has_base:
        return _translated(graph, _alternating(graph, seed))
    rotations = _linear(graph)
    return _spanned(graph) if rotations is None else _translated(graph, rotations)


def _linear(graph: Graph) -> Array | None:
    """(m, 3, 3) rotations by the smallest eigenvector; None where the second is as small."""
    G = np.concatenate([graph.robot, np.eye(4)[None]])[:, :3, :3]
    M = np.zeros((graph.m, graph.m, 9, 9))
    count = np.bincount(np.concatenate([graph.X, graph.W]), minlength=graph.m)
    for edges, numbers in graph.kinds:
        pair, both = numbers[:2], np.zeros((18, 18))
        for start in range(0, len(edges), VIEWS_TOGETHER):
            some = edges[start : start + VIEWS_TOGETHER]
            left, right = (G[side[some]] for side in graph.side)
            by_X = left[:, :, None, :, None] * graph.C[some, :3, :3].mT[:, None, :, None, :]
            by_W = -(right[:, :, None, :, None] * np.eye(3)[:, None, :])
            rows = np.concatenate([by.reshape(-1, 9) for by in (by_X, by_W)], axis=-1)
            both += rows.T @ rows
        M[pair[:, None], pair] += both.reshape(2, 9, 2, 9).swapaxes(1, 2)
    whole = M.swapaxes(1, 2).reshape(9 * graph.m, -1)
    scale = np.repeat(1.0 / np.sqrt(np.maximum(count, 1)), 9)  # each unknown counts alike, however often it is seen
    values, vectors = eigh(whole * np.outer(scale, scale), subset_by_index=[0, 1])
    if values[1] < MIN_ROTATION_GAP or values[1] < 4.0 * values[0]:
        return None
    R = (scale * vectors[:, 0]).reshape(graph.m, 3, 3)
    R = R * np.sign(np.linalg.det(R).sum())
    return nearest_rotation(R)[0]


def _alternating(graph: Graph, seed: int, starts: int = 60) -> Array:
    """(m, 3, 3) rotations of rigs with several arms: each from the others, from random starts."""
    rng = np.random.default_rng(seed)
    some = graph
    if graph.E > 400:
        looked = np.isin(np.arange(graph.E), rng.permutation(graph.E)[:400])
        some = graph.of_edges(np.flatnonzero(looked)) if _all_seen(graph, looked) else graph
    m, E = some.m, some.E
    R = nearest_rotation(rng.normal(size=(starts, m, 3, 3)))[0]
    eye = np.broadcast_to(np.eye(3), (starts, 1, 3, 3))
    G = np.concatenate([some.robot[:, :3, :3], np.eye(3)[None]])
    G_l, G_r, R_C = G[some.side[0]], G[some.side[1]], some.C[:, :3, :3]
    for _ in range(150):
        for u in range(m):
            T = np.concatenate([R, eye], axis=1)
            B_l, B_r = T[:, some.base[0]], T[:, some.base[1]]
            L, Q = B_l @ G_l @ R[:, some.X] @ R_C, B_r @ G_r @ R[:, some.W]
            total = np.zeros((starts, 3, 3))
            if (of := np.equal(some.X, u)).any():
                total += ((B_l @ G_l)[:, of].mT @ Q[:, of] @ R_C[of].mT).sum(axis=1)
            if (of := np.equal(some.W, u)).any():
                total += ((B_r @ G_r)[:, of].mT @ L[:, of]).sum(axis=1)
            if (of := (some.base[0] == u) & (some.base[1] != u)).any():
                total += (Q[:, of] @ L[:, of].mT @ R[:, None, u]).sum(axis=1)
            if (of := (some.base[1] == u) & (some.base[0] != u)).any():
                total += (L[:, of] @ Q[:, of].mT @ R[:, None, u]).sum(axis=1)
            if np.abs(total).max() > 0:
                R[:, u] = nearest_rotation(total)[0]
    T = np.concatenate([R, eye], axis=1)
    L = T[:, some.base[0]] @ G_l @ R[:, some.X] @ R_C
    Q = T[:, some.base[1]] @ G_r @ R[:, some.W]
    misfit = np.median(((L - Q) ** 2).sum(axis=(-2, -1)), axis=1) if E > 4 else ((L - Q) ** 2).sum(axis=(1, 2, 3))
    return np.asarray(R[int(np.argmin(misfit))])


def _translated(graph: Graph, R: Array) -> Array:
    """All poses of these rotations, with translations by linear least squares."""
    m, E = graph.m, graph.E
    at = np.tile(np.eye(4), (m, 1, 1))
    at[:, :3, :3] = R
    T = np.concatenate([at, np.eye(4)[None]])
    G = np.concatenate([graph.robot, np.eye(4)[None]])
    A, c = np.zeros((E, 3, m + 1, 3)), np.zeros((E, 3))
    edge = np.arange(E)
    for k, (base, side) in enumerate(zip(graph.base, graph.side, strict=True)):
        sign = -1.0 if k else 1.0
        R_B, g = T[base][:, :3, :3], G[side]
        A[edge, :, base] += sign * np.eye(3)
        A[edge, :, graph.W if k else graph.X] += sign * R_B @ g[:, :3, :3]
        c += sign * (R_B @ g[:, :3, 3:])[..., 0]
    c += (T[graph.base[0]] @ G[graph.side[0]] @ at[graph.X])[:, :3, :3].__matmul__(graph.C[:, :3, 3:])[..., 0]
    rows = A[:, :, :m].reshape(3 * E, 3 * m)
    at[:, :3, 3] = np.linalg.lstsq(rows, -c.reshape(-1), rcond=1e-9)[0].reshape(m, 3)
    return at


def _spanned(graph: Graph) -> Array:
    """All poses from the pair that is seen most often, along a tree of the edges."""
    seen: dict[tuple[int, int], int] = {}
    moving = (graph.side[0] < graph.P) ^ (graph.side[1] < graph.P)
    for X, W in zip(graph.X[moving].tolist(), graph.W[moving].tolist(), strict=True):
        seen[X, W] = seen.get((X, W), 0) + 1
    best, error = None, None
    at = np.tile(np.eye(4), (graph.m, 1, 1))
    done: set[int] = set()
    for X, W in sorted(seen, key=lambda pair: -seen[pair]):
        if seen[X, W] < 3 or done & {X, W}:
            continue
        try:
            pair = _pair(graph, X, W)
        except (DegenerateMotionError, InputError) as failed:
            error = failed
            continue
        at[X], at[W] = pair[X], pair[W]
        done |= {X, W}
        best = X
        _grown(graph, at, done)
    if best is None or len(done) < graph.m:
        raise error or DegenerateMotionError(
            "The robot poses turn about too few axes to find a start for all cameras and targets. Add motions that "
            "rotate about another axis.",
            np.eye(6),
        )
    return at


def _grown(graph: Graph, at: Array, done: set[int]) -> None:
    """Set all poses that edges lead to from those that are done."""
    G = np.concatenate([graph.robot, np.eye(4)[None]])
    while True:
        has_X, has_W = np.isin(graph.X, list(done)), np.isin(graph.W, list(done))
        open_ = np.flatnonzero(has_X ^ has_W)
        if not len(open_):
            return
        to = np.where(has_X[open_], graph.W[open_], graph.X[open_])
        u = int(np.bincount(to).argmax())
        edges = open_[to == u]
        left, right = G[graph.side[0][edges]], G[graph.side[1][edges]]
        if has_X[edges[0]]:
            measured = inverse(right) @ left @ at[graph.X[edges]] @ graph.C[edges]
        else:
            measured = inverse(left) @ right @ at[graph.W[edges]] @ inverse(graph.C[edges])
        at[u, :3, :3] = nearest_rotation(measured[:, :3, :3].sum(axis=0))[0]
        at[u, :3, 3] = np.median(measured[:, :3, 3], axis=0)
        done.add(u)


# ------------------------------------------------------------------------------------------- what is tied
