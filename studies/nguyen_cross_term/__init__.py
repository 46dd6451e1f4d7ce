"""Cross-covariance in Nguyen and Pham's translation stage: as derived, and as published.

Model: ``A X = X B``, each motion its true value with a Gaussian error ``xi = (theta, tau)``, left rotation, additive
translation, of equal covariance on A and B. The translation stage needs ``Cov(q_k, phi_k)`` of the residual and the
refined rotation: "derived" is that of docs/explanation/nguyen_pham.md, "published" has the other sign and another
lever. The paper's Fig. 5 and section IV-C compare with this method.

Three tables: data sets with a geometry of their own (rotations of 0.4 to 2.6 rad, translations of 0.5 m per axis; 5,000
per row, quick: 250), data sets of one geometry of 60 pairs (500, quick: 25), and the two rules of stopping in metres,
millimetres and nanometres (150, quick: 15). Seed 2018. NEES of t is ``e^T Sigma_t^-1 e`` of the error of the
translation with the method's own covariance; its mean is 3 if that is true. Data sets that did not converge are left
out of it and counted. NEES of X, 6 if true, is with the 6x6 covariance of `NguyenDerivatives`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import uq_handeye as uq
from studies.common.geometries import random_transforms
from studies.common.scores import errors, nees, true_means
from studies.common.study import Study, Tables, markdown
from uq_handeye.core.geometry.se3 import Array, inverse, perturb
from uq_handeye.core.presentation.colours import BLUE, GRID, ORANGE
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.methods.gauss_newton import Stop
from uq_handeye.methods.nguyen import NguyenDerivatives, nguyen
from uq_handeye.methods.nguyen_stages import CrossTerm, NguyenResult

SEED = 2018
KINDS: tuple[CrossTerm, ...] = ("derived", "published")
STOPS: tuple[Stop, ...] = ("scaled", "published")
# Pairs, deviations in rad and m.
OWN = (
    (3, 1e-4, 1e-4),
    (3, 1e-4, 3e-5),
    (5, 1e-4, 1e-4),
    (5, 1e-4, 3e-5),
    (5, 1e-4, 1e-5),
    (10, 1e-4, 1e-4),
    (10, 1e-4, 3e-5),
    (60, 1e-4, 1e-4),
    (60, 1e-4, 1e-5),
)


def noisy(rng: np.random.Generator, T: Array, sd: Array) -> Array:
    return perturb(T, sd * rng.normal(size=(*T.shape[:-2], 6)))


def in_unit(T: Array, unit: float) -> Array:
    T = T.copy()
    T[..., :3, 3] *= unit
    return T


def label(rotation: float, translation: float) -> str:
    return f"{1e3 * rotation:g} mrad, {1e3 * translation:g} mm"


def deviations(rotation: float, translation: float) -> Array:
    """Return the standard deviations of xi = (theta, tau), rad and m."""
    return np.repeat([rotation, translation], 3)


def nees_of_t(result: NguyenResult, X: Array) -> float | None:
    """None if nothing converged."""
    ok = result.converged
    if not ok.any():
        return None
    return float(nees((result.X[:, :3, 3] - X[..., :3, 3])[ok], result.Sigma_t[ok]).mean())


def nees_of_X(result: NguyenResult, X: Array, A: Array, B: Array, noise: uq.PairNoise) -> float:
    """Return the NEES of the whole X with its 6x6 covariance from `NguyenDerivatives`, over all data sets; should
    be 6.
    """
    derivatives = NguyenDerivatives(result, noise)
    F = derivatives.block(A, B)
    Q = derivatives.weight(A.shape[1])
    Sigma = Q @ sum(
        np.einsum("ijtm,jk,lktm->til", side, S, side, optimize=True)
        for side, S in zip(F, (noise.A, noise.B), strict=True)
        if S is not None
    )
    Sigma = Sigma @ Q.mT
    return float(nees(errors(result.X, X), Sigma).mean())


def own_geometries(sets: int) -> pd.DataFrame:
    """Each data set with a geometry of its own."""
    rows = []
    for row, (N, rotation, translation) in enumerate(OWN):
        rng = np.random.default_rng([SEED, 1, row])
        X, B = random_transforms(rng, (sets, 1)), random_transforms(rng, (sets, N))
        A, X = X @ B @ inverse(X), X[:, 0]
        sd = deviations(rotation, translation)
        noise = uq.PairNoise(np.diag(sd**2), np.diag(sd**2))
        a, b = noisy(rng, A, sd), noisy(rng, B, sd)
        for kind in KINDS:
            found = nguyen(a, b, noise, cross_term=kind)
            rows.append(
                {
                    "pairs": N,
                    "noise": label(rotation, translation),
                    "cross_term": kind,
                    "data_sets": sets,
                    "converged": int(found.converged.sum()),
                    "mean_nees_t": nees_of_t(found, X),
                    "mean_nees_X": nees_of_X(found, X, a, b, noise) if kind == "derived" else None,
                }
            )
    return pd.DataFrame(rows)


def one_geometry(sets: int) -> pd.DataFrame:
    """60 pairs; star: all B have the same translation (0.3, 0, 0.4) m."""
    rows = []
    for row, (star, rotation, translation) in enumerate(
        [(False, 1e-3, 1e-3), (False, 1e-2, 1e-4), (True, 1e-3, 1e-4), (True, 1e-2, 1e-4)]
    ):
        rng = np.random.default_rng([SEED, 2, row])
        X, B = random_transforms(rng, ()), random_transforms(rng, (60,))
        if star:
            B[:, :3, 3] = [0.3, 0.0, 0.4]
        A = X @ B @ inverse(X)
        sd = deviations(rotation, translation)
        noise = uq.PairNoise(np.diag(sd**2), np.diag(sd**2))
        a, b = (noisy(rng, np.broadcast_to(T, (sets, 60, 4, 4)), sd) for T in (A, B))
        for kind in KINDS:
            for stop in STOPS:
                found = nguyen(a, b, noise, cross_term=kind, stop=stop)
                turns, shifts = found.iterations.mean(axis=0)
                rows.append(
                    {
                        "geometry": "star" if star else "random",
                        "noise": label(rotation, translation),
                        "cross_term": kind,
                        "stop": stop,
                        "data_sets": sets,
                        "converged": int(found.converged.sum()),
                        "mean_iterations_R": turns,
                        "mean_iterations_t": shifts,
                        "mean_nees_t": nees_of_t(found, X),
                        "mean_nees_X": nees_of_X(found, X, a, b, noise) if kind == "derived" else None,
                    }
                )
    return pd.DataFrame(rows)


def units(sets: int) -> pd.DataFrame:
    """60 pairs of one geometry, the same data in metres, millimetres, and nanometres."""
    rows = []
    for row, (rotation, translation) in enumerate([(1e-2, 1e-3), (0.3, 0.1)]):
        rng = np.random.default_rng([SEED, 3, row])
        X, B = random_transforms(rng, ()), random_transforms(rng, (60,))
        A = X @ B @ inverse(X)
        sd = deviations(rotation, translation)
        a, b = (noisy(rng, np.broadcast_to(T, (sets, 60, 4, 4)), sd) for T in (A, B))
        for stop in STOPS:
            for name, unit in (("m", 1.0), ("mm", 1e3), ("nm", 1e9)):
                S = np.diag((sd * deviations(1.0, unit)) ** 2)
                found = nguyen(in_unit(a, unit), in_unit(b, unit), uq.PairNoise(S, S), stop=stop)
                turns, shifts = found.iterations.mean(axis=0)
                rows.append(
                    {
                        "noise": label(rotation, translation),
                        "stop": stop,
                        "unit": name,
                        "data_sets": sets,
                        "converged": int(found.converged.sum()),
                        "mean_iterations_R": turns,
                        "mean_iterations_t": shifts,
                    }
                )
    return pd.DataFrame(rows)


def measure(full: bool) -> Tables:
    own, one, of_units = (5_000, 500, 150) if full else (250, 25, 15)
    return {"own_geometries": own_geometries(own), "one_geometry": one_geometry(one), "units": units(of_units)}


def true(table: pd.DataFrame, column: str, freedom: int) -> pd.Series[bool]:
    """Return whether the mean NEES is that of a consistent covariance; not where nothing converged."""
    count = table["converged"] if freedom == 3 else table["data_sets"]
    low, high = np.array([true_means(max(int(n), 1), freedom) for n in count]).T
    return table[column].between(low, high)


def mean(value: Any) -> str:
    return "-" if np.isnan(value) else f"{value:.2f}"


def share(row: Any) -> str:
    return f"{100 * row.converged / row.data_sets:.1f} %"


def findings(tables: Tables) -> str:
    own, one, of_units = (tables[name] for name in ("own_geometries", "one_geometry", "units"))
    return "\n\n".join([*of_own(own), *of_one(one), *of_stopping(of_units)])


def of_own(table: pd.DataFrame) -> list[str]:
    derived, published = (table[table["cross_term"] == kind].reset_index(drop=True) for kind in KINDS)
    rows = [
        [d.pairs, d.noise, share(d), mean(d.mean_nees_t), share(p), mean(p.mean_nees_t), mean(d.mean_nees_X)]
        for d, p in zip(derived.itertuples(), published.itertuples(), strict=True)
    ]
    sets = int(table["data_sets"].iloc[0])
    sentences = []
    for kind, found in zip(KINDS, (derived, published), strict=True):
        holds = true(found, "mean_nees_t", 3)
        least, most = found["mean_nees_t"].min(), found["mean_nees_t"].max()
        lost = (found["converged"] < found["data_sets"]).sum()
        sentences.append(
            f"- {kind}: NEES of t {least:.2f} to {most:.2f}, that of a consistent covariance in {holds.sum()} of "
            f"{len(found)} rows; data sets that do not converge in {lost} rows, at most "
            f"{100 * (1 - (found['converged'] / found['data_sets']).min()):.1f} %."
        )
    holds = true(derived, "mean_nees_X", 6)
    sentences.append(
        f"- 6x6 covariance of X to first order (derived): NEES of X that of a consistent covariance in {holds.sum()} "
        f"of {len(derived)} rows."
    )
    ranges = [true_means(sets, freedom) for freedom in (3, 6)]
    return [
        f"Each data set with a geometry of its own, {sets:,} per row. 99.9 % of the mean NEES of a consistent "
        f"covariance lie between {ranges[0][0]:.2f} and {ranges[0][1]:.2f} for t, {ranges[1][0]:.2f} and "
        f"{ranges[1][1]:.2f} for X (wider where data sets did not converge).",
        markdown(
            [
                "pairs",
                "noise",
                "derived: converged",
                "NEES of t",
                "published: converged",
                "NEES of t",
                "NEES of X (derived)",
            ],
            rows,
        ),
        "\n".join(sentences),
    ]


def of_one(table: pd.DataFrame) -> list[str]:
    rows = [
        [
            row.geometry,
            row.noise,
            row.cross_term,
            row.stop,
            row.converged,
            f"{row.mean_iterations_R:.1f}, {row.mean_iterations_t:.1f}",
            mean(row.mean_nees_t),
            mean(row.mean_nees_X),
        ]
        for row in table.itertuples()
    ]
    first = table[table["stop"] == STOPS[0]]
    derived, published = (first[first["cross_term"] == kind] for kind in KINDS)
    return [
        f"One geometry of 60 pairs, {int(table['data_sets'].iloc[0])} data sets; star: all B have one translation.",
        markdown(
            [
                "geometry",
                "noise",
                "cross term",
                "stop",
                "converged",
                "mean iterations R, t",
                "NEES of t",
                "NEES of X",
            ],
            rows,
        ),
        f"The covariance of t stays wrong with the derived form too in {(~true(derived, 'mean_nees_t', 3)).sum()} of "
        f"{len(derived)} cases (NEES {derived['mean_nees_t'].min():.2f} to {derived['mean_nees_t'].max():.2f}, not 3), "
        f"while the 6x6 covariance of X is true in {true(derived, 'mean_nees_X', 6).sum()} of {len(derived)}. With the "
        f"published form nothing converges in {(published['converged'] == 0).sum()} of {len(published)} cases.",
    ]


def of_stopping(table: pd.DataFrame) -> list[str]:
    rows = [
        [row.noise, row.stop, row.unit, row.converged, f"{row.mean_iterations_R:.2f}, {row.mean_iterations_t:.2f}"]
        for row in table.itertuples()
    ]
    columns, said = ["converged", "mean_iterations_R", "mean_iterations_t"], []
    for stop in STOPS:
        own = table[table["stop"] == stop].groupby("noise", sort=False)
        same = sum(len(of[columns].drop_duplicates()) == 1 for _, of in own)
        worst = int(own["converged"].agg(lambda of: of.max() - of.min()).max())
        said.append(
            f"with the {stop} rule convergence and iterations are the same in all units in {same} of {own.ngroups} "
            f"cases, and up to {worst} data sets more converge in one unit than in another"
        )
    return [
        f"Stopping: 60 pairs, {int(table['data_sets'].iloc[0])} data sets of one geometry, in three units of length.",
        markdown(["noise", "stop", "unit", "converged", "mean iterations R, t"], rows),
        f"W{'; '.join(said)[1:]}.",
    ]


def figures(tables: Tables) -> dict[str, Figure]:
    table = tables["own_geometries"]
    cases = list(table[["pairs", "noise"]].drop_duplicates().itertuples(index=False, name=None))
    figure = canvas(3.3)
    distance, lost = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    distance.axvspan(*true_means(int(table["data_sets"].iloc[0]), 3), color=GRID)
    for kind, colour, marker, shift in zip(KINDS, (BLUE, ORANGE), "os", (-0.14, 0.14), strict=True):
        own = table[table["cross_term"] == kind]
        y = np.arange(len(own)) + shift
        look = {"color": colour, "marker": marker, "markersize": 5, "linestyle": "none"}
        distance.plot(own["mean_nees_t"], y, **look)
        lost.plot(100 * own["converged"] / own["data_sets"], y, label=kind, **look)
    for axis in (distance, lost):
        plain(axis)
        axis.tick_params(axis="y", length=0)
    distance.set_xscale("log")
    marks = [mark for mark in (3, 5, 10, 20, 50, 100, 200, 500) if mark < 1.3 * table["mean_nees_t"].max()]
    distance.set_xticks(marks, [str(mark) for mark in marks])
    distance.minorticks_off()
    distance.set_xlabel("mean NEES of t (band: of a true covariance)", fontsize=TEXT)
    lost.set_xlabel("data sets that converge (%)", fontsize=TEXT)
    lost.set_xlim(0, 104)
    distance.set_ylim(len(cases) - 0.5, -0.5)
    distance.set_yticks(range(len(cases)), [f"{N} pairs, {noise}" for N, noise in cases], fontsize=SMALL)
    handles, labels = lost.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, fontsize=SMALL, frameon=False)
    return {"cross_term": finished(figure)}


STUDY = Study("nguyen_cross_term", measure, findings, figures)
