"""Comparison of the eigen form of 4-D registration (Problem 1, (13)-(26)) with SVD, and a check of its covariance.

Model (13): v_i = R u_i + t + noise, R in SO(4) or SO(3), N = 20 points, normal with 1 m per axis. Registration by
singular value decomposition is ``uq.register`` (14)-(15). The eigen forms take the generated matrices K (19) and W
(25): largest eigenvector of the 8x8 W (24), leading singular vectors of the 4x4 K, and the largest eigenvector of
K^T K (26). In 3-D, K of the correlation bordered with zeros, read as a quadratic form of one quaternion, is Davenport's
matrix.

Measured: agreement with NumPy's SVD and SciPy's ``align_vectors`` on generic, coplanar, collinear and mirrored points;
(14) as printed; time over batches of 1 to 10,000 problems; the first-order covariance of (R, t) against Monte Carlo,
with isotropic noise of 5 mm and with a full covariance for each point of both sets, 20,000 draws (quick: 2,000), and
the paper's (39)-(48) against it; Problem 2 as two Davenport matrices (T1), its limit as Wahba's problem, and the QUEST
covariance of Shuster and Oh against that of 4DPA. Seed 2019.

Differs from the paper, which states Problem 1 without an experiment: everything here is simulated.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from studies.common.scores import true_means
from studies.common.study import Study, Tables, markdown
from studies.registration.covariance import covariance_rows, eigenvalue_interval, quest_rows, wahba_rows
from studies.registration.forms import FORMS, POINTS, SCIPY, SVD, agreement_rows, printed_rows, time_rows
from uq_handeye.core.presentation.colours import BLUE, GREEN, INK, ORANGE, PURPLE, QUIET, SKY
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain

SEED = 2019


def measure(full: bool) -> dict[str, pd.DataFrame]:
    trials = 20_000 if full else 2_000
    batches = (1, 10, 100, 1_000, 10_000) if full else (1, 10, 100, 1_000)
    rows: dict[str, Iterator[dict[str, Any]]] = {
        "agreement": agreement_rows(np.random.default_rng([SEED, 1]), 1_000 if full else 100),
        "printed": printed_rows(np.random.default_rng([SEED, 2]), 100),
        "times": time_rows(np.random.default_rng([SEED, 3]), batches, 9 if full else 3),
        "covariance": covariance_rows(np.random.default_rng([SEED, 4]), trials),
        "wahba": wahba_rows(np.random.default_rng([SEED, 5])),
        "quest": quest_rows(np.random.default_rng([SEED, 6]), trials),
    }
    return {name: pd.DataFrame(part) for name, part in rows.items()}


# ---------------------------------------------------------------------------------------------------- what was found

ROUNDING = 1e-10  # below which matrices of order 1 that are computed in two ways count as equal
UNIQUE = ("generic", "n - 1 directions", "mirrored", "noise only")


def findings(tables: Tables) -> str:
    parts = (agree, printed, times, covariances, davenports, quests)
    return "\n\n".join(part(tables) for part in parts)


def agree(tables: Tables) -> str:
    table = tables["agreement"]
    unique, open_ = table[table["points"].isin(UNIQUE)], table[table["points"] == "n - 2 directions"]
    four = unique[unique["n"] == 4]["largest difference from SVD"].max()
    three = unique[(unique["n"] == 3) & (unique["form"] == "Davenport, 4x4")]["largest difference from SVD"].max()
    scipy = unique[unique["form"] == SCIPY]["largest difference from SVD"].max()
    bordered = unique[unique["form"] == "W of bordered H"]
    rows = [
        (row["n"], row["points"], row["form"], f"{row['largest difference from SVD']:.1e}", int(row["reflections"]))
        for _, row in unique.iterrows()
    ]
    trials = int(table["trials"].min())
    return (
        f"**Eigen form against SVD** ({trials} problems per row). The 4-D forms (24), K and (26) differ from the SVD "
        f"by {four:.0e} at most where the rotation is unique: they {'agree' if four < ROUNDING else 'do not agree'} "
        f"to rounding, mirrored and unrelated points among them. In 3-D Davenport's matrix ({three:.0e}) and SciPy "
        f"({scipy:.0e}) {'agree' if max(three, scipy) < ROUNDING else 'do not agree'} with the SVD as well. The 4-D "
        f"form on 3-D points does not: SO(4) holds diag(-1, reflection), and {int(bordered['reflections'].sum())} of "
        f"{int(bordered['trials'].sum())} answers are reflections.\n\n"
        + markdown(("n", "points", "form", "largest difference from SVD", "reflections"), rows)
        + "\n\nWith points in n - 2 directions more than one rotation fits: all forms answer all the same, up to "
        f"{open_['largest difference from SVD'].max():.1f} apart with equal sums of squares (to "
        f"{open_['largest loss of tr(R H), relative'].abs().max():.0e}). `uq.register` refuses "
        f"{int(open_.groupby('n')['refused by uq.register'].first().sum())} of {2 * trials} of these and "
        f"{int(unique.groupby(['n', 'points'])['refused by uq.register'].first().sum())} of "
        f"{2 * len(UNIQUE) * trials} of the others."
    )


def printed(tables: Tables) -> str:
    table = tables["printed"]
    same = bool((table["det(U V) less det(U V^T)"] < ROUNDING).all())
    inverse_ = bool((table["RMS residual as printed (m)"] > 10 * table["RMS residual transposed (m)"]).all())
    said = "; ".join(
        f"n = {row['n']:.0f}: {row['RMS residual as printed (m)']:.2g} m, transposed "
        f"{row['RMS residual transposed (m)']:.2g} m"
        for _, row in table.iterrows()
    )
    return (
        f"**(14) as printed.** det(UV) {'is' if same else 'is not'} det(UV^T), so that the sign is right. The order "
        f"of the factors {'is not' if inverse_ else 'is'}: with H of (15) `U diag V^T` "
        f"{'is the inverse rotation' if inverse_ else 'fits'}. RMS residual with noise of "
        f"{1e3 * table['noise (m)'].iloc[0]:g} mm: {said}."
    )


def times(tables: Tables) -> str:
    table = tables["times"]
    batches = sorted(set(table["batch"]))
    shown = [batches[0], batches[len(batches) // 2], batches[-1]]
    rows = []
    for (n, form), part in table.groupby(["n", "form"], sort=False):
        ratio = part.set_index("batch")["time / SVD"]
        rows.append((n, form, *(f"{ratio[batch]:.1f}" for batch in shown)))
    eigen = table[table["form"].isin([*FORMS[4], *FORMS[3]])]
    faster = eigen[eigen["time / SVD"] < 1]
    return (
        "**Time** from the points to R and t, as a multiple of `uq.register`, one core:\n\n"
        + markdown(("n", "form", *(f"{batch:,} at once" for batch in shown)), rows)
        + f"\n\nAn eigen form was faster than `uq.register`, which also checks its input, in {len(faster)} of "
        f"{len(eigen)} cases."
    )


def judged(row: pd.Series) -> bool:
    """Return whether NEES and all whitened eigenvalues are what chance allows a consistent covariance."""
    k, trials = int(row["components"]), int(row["trials"])
    low, high = (bound / k for bound in true_means(trials, k))
    least, largest = eigenvalue_interval(k, trials)
    return bool(
        low < row["NEES / components"] < high
        and least < row["least whitened eigenvalue"]
        and row["largest whitened eigenvalue"] < largest
    )


def covariances(tables: Tables) -> str:
    table = tables["covariance"]
    rows = [
        (
            row["n"],
            row["noise"],
            row["covariance"],
            f"{row['NEES / components']:.3f}",
            f"{row['least whitened eigenvalue']:.2f} to {row['largest whitened eigenvalue']:.2f}",
            "consistent" if judged(row) else "rejected",
        )
        for _, row in table.iterrows()
    ]
    ours = table[table["covariance"] == "first order"]
    wrong = table[table["covariance"] != "first order"]
    paper = ours["by (39)-(48), relative difference"].max()
    closed = ours["closed form sigma^2 M^-1, relative difference"].max()
    return (
        f"**Covariance of the registration**, {int(table['trials'].min()):,} draws: NEES divided by its number of "
        "components and eigenvalues of the sample covariance whitened with the predicted one, all 1 if it is "
        "true.\n\n"
        + markdown(("n", "noise", "covariance", "NEES / components", "whitened eigenvalues", "verdict"), rows)
        + f"\n\nThe first-order covariance is consistent with Monte Carlo in {sum(map(judged, rows_of(ours)))} of "
        f"{len(ours)} cases; of {len(wrong)} wrong ones {sum(not judged(row) for row in rows_of(wrong))} are "
        "rejected. The paper's (39)-(48), applied to W of Problem 1 with the errors of the points added one by "
        f"one, gives the same rotation covariance {'to rounding' if paper < ROUNDING else 'only roughly'} (relative "
        f"difference {paper:.0e}), as does the known closed form of 3-D with equal isotropic noise ({closed:.0e})."
    )


def rows_of(table: pd.DataFrame) -> list[pd.Series]:
    return [row for _, row in table.iterrows()]


def davenports(tables: Tables) -> str:
    table = tables["wahba"]
    finite = table[np.isfinite(table["d"])]
    matrix, q = finite["Davenport's matrix, relative difference"].max(), finite["q-method, from SciPy (rad)"].max()
    limit = table.loc[~np.isfinite(table["d"]), "from Wahba on (u, v) (rad)"].iloc[0]
    apart = finite.set_index("d")["from Wahba on (u, v) (rad)"]
    order = np.log10(apart[1e2] / apart[1e4]) / 2
    holds = max(matrix, q, limit) < ROUNDING
    return (
        f"**Attitude determination** ({int(table['pairs'].iloc[0])} noisy pairs, d = 1e1 to 1e8). F11 and F22 of "
        f"Problem 2 are Davenport's matrices of (a, b) and (c, e) to {matrix:.0e}, and their eigenvectors are the "
        f"rotations that SciPy finds for these vectors, to {q:.0e} rad. In the limit 4DPA's rotation is that of "
        f"Wahba's problem on (u, v) to {limit:.0e} rad: T1 and T2 {'hold' if holds else 'do not hold'}. At d = 1e2 it "
        f"is {apart[1e2]:.0e} rad away, at 1e4 {apart[1e4]:.0e} rad, as d to the power {-order:.2f}."
    )


def quests(tables: Tables) -> str:
    table = tables["quest"].set_index("motions")
    right, others = table.iloc[0], table.iloc[1]
    low, high = (bound / 3 for bound in true_means(int(right["trials"]), 3))
    equal = right["QUEST from 4DPA's, relative"] < ROUNDING
    ratio = others["NEES / 3 with QUEST's"]
    return (
        f"**QUEST.** For motions by 90 degrees Shuster and Oh's covariance {'is' if equal else 'is not'} that of "
        f"4DPA's rotation (relative difference {right['QUEST from 4DPA' + chr(39) + 's, relative']:.0e}); NEES / 3 "
        f"over {int(right['trials']):,} trials {right['NEES / 3 with QUEST' + chr(39) + 's']:.3f} (99.9 % between "
        f"{low:.3f} and {high:.3f}). For motions by {table.index[1]} that formula with equal weights gives NEES / 3 = "
        f"{ratio:.2f} and {'is rejected' if not low < ratio < high else 'cannot be rejected at this size'}, where "
        f"4DPA's own gives {others['NEES / 3 with 4DPA' + chr(39) + 's']:.3f}: a motion by θ counts with sin²θ in "
        "Wahba's problem, and with that weight the formula of attitude determination is 4DPA's again (to "
        f"{table['weights sin^2 from 4DPA' + chr(39) + 's, relative'].max():.0e}). The weights that the noise asks "
        f"for are 1 - cos θ; by not having them the rotation has up to {others['largest sd / best weights']:.2f} "
        f"times the smallest standard deviation that their rotations allow "
        f"({right['largest sd / best weights']:.2f} at 90 degrees)."
    )


# ------------------------------------------------------------------------------------------------------------ figures

_LINES = {
    "SVD of H alone": (INK, "s", ":"),
    "W, 8x8 (24)": (ORANGE, "^", "--"),
    "K, 4x4": (BLUE, "o", "-"),
    "K^T K (26)": (GREEN, "D", "-."),
    "Davenport, 4x4": (BLUE, "P", "-."),
    "W of bordered H": (SKY, "v", "--"),
    SCIPY: (PURPLE, "X", "-."),
}


def figures(tables: Tables) -> dict[str, Figure]:
    return {"times": times_figure(tables["times"]), "covariance": covariance_figure(tables)}


def times_figure(table: pd.DataFrame) -> Figure:
    figure = canvas(3.3)
    for axis, n in zip(figure.subplots(1, 2), (4, 3), strict=True):
        for form, part in table[(table["n"] == n) & (table["form"] != SVD)].groupby("form", sort=False):
            colour, marker, line = _LINES[str(form)]
            axis.plot(
                part["batch"], part["time / SVD"], color=colour, marker=marker, linestyle=line, markersize=4, label=form
            )
        axis.axhline(1.0, color=QUIET, linewidth=0.8)
        axis.set_xscale("log")
        axis.set_yscale("log")
        low, high = axis.get_ylim()
        ticks = [tick for tick in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100) if low < tick < high]
        axis.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.set_yticks([], minor=True)
        axis.set_title(f"{n}-D, {POINTS} points", fontsize=TEXT)
        axis.set_xlabel("problems at once", fontsize=SMALL)
        plain(axis)
    figure.axes[0].set_ylabel("time / uq.register", fontsize=SMALL)
    known: dict[str, Any] = {}
    for axis in figure.axes:
        handles, labels = axis.get_legend_handles_labels()
        known |= dict(zip(labels, handles, strict=True))
    figure.legend(known.values(), known.keys(), loc="outside lower center", ncols=3, fontsize=SMALL, frameon=False)
    return finished(figure)


def covariance_figure(tables: Tables) -> Figure:
    figure = canvas(4.6)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.1))
    table = tables["covariance"].iloc[::-1].reset_index(drop=True)
    labels = []
    for place, row in table.iterrows():
        fine = row["covariance"] == "first order"
        least, largest = eigenvalue_interval(int(row["components"]), int(row["trials"]))
        left.barh(place, largest - least, left=least, height=0.8, color=SKY, alpha=0.6)
        ends = (row["least whitened eigenvalue"], row["largest whitened eigenvalue"])
        left.plot(ends, (place, place), color=BLUE if fine else ORANGE, marker="o" if fine else "X", markersize=4)
        labels.append(f"{row['n']}-D, {row['noise']}\n{row['covariance']}")
    left.axvline(1.0, color=INK, linewidth=0.8)
    left.set_yticks(range(len(labels)), labels)
    left.set_xscale("log")
    ticks = (0.5, 1, 2, 4)
    left.set_xticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
    left.set_xticks([], minor=True)
    left.set_xlabel("whitened eigenvalues, all 1 if true", fontsize=SMALL)
    plain(left)
    wahba = tables["wahba"]
    finite = wahba[np.isfinite(wahba["d"])]
    right.plot(
        finite["d"], finite["from Wahba on (u, v) (rad)"], color=BLUE, marker="o", markersize=4, label="4DPA at d"
    )
    limit = wahba.loc[~np.isfinite(wahba["d"]), "from Wahba on (u, v) (rad)"].iloc[0]
    right.axhline(limit, color=INK, linestyle="--", linewidth=1.1, label="4DPA, limit")
    right.set_xscale("log")
    right.set_yscale("log")
    right.set_xlabel("scaling factor d", fontsize=SMALL)
    right.set_ylabel("rotation: distance from Wahba on (u, v) (rad)", fontsize=SMALL)
    plain(right)
    right.legend(fontsize=SMALL, frameon=False)
    return finished(figure)


STUDY = Study("registration", measure, findings, figures, packages=("pandas", "matplotlib"))
