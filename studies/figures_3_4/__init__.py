"""Test whether the error (62) separates hand-eye methods and scaling factors d, as noise grows (Figs. 3 and 4).

The noise is that of the paper: (63), ``R + s G`` with nine independent standard normal entries of G, then
orthonormalised, and (64), ``t + s g``, on every A and B. Fig. 3 has noise of rotation only, Fig. 4 of translation
only. Each of 10 repeats at each level draws X, 1,000 motions and their noise again (quick: 3 levels, 3 repeats of 100
motions, without `zhao`): angles of 0.4 to 2.6 rad about axes of any direction, translations normal with 0.5 m per axis,
as the paper gives none. Levels from 1e-6 to 1e-1, half a decade apart. All methods of the paper's comparison, four more
(`gwak`, `condurache`, `nguyen`, `efficient`), 4DPA at d = 1e3 to 1e6 m and in its limit. To first order, (63) is a
rotation vector with covariance ``s^2/2 I``: the skew part of ``s G R^T``, whose entries are again independent normal,
has ``(G_32 - G_23)/2`` and so on. `nguyen` and `efficient` are told that, and a thousandth of it for the side that has
no noise. Beside (62) stands what it hides, the error of X against the truth. Seed 2019.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

import uq_handeye as uq
from studies.common.study import Study, Tables, markdown
from studies.common.styles import style
from studies.figures_3_4.rig import (
    FINITE,
    KINDS,
    LEVELS,
    LIMIT,
    METHODS,
    OPTIMISING,
    PAPER,
    SCALES,
    Data,
    assumed,
    disturbed,
    error_62,
    estimated,
    exact,
    scores,
)
from uq_handeye.core.geometry.se3 import Array, logarithm
from uq_handeye.core.presentation.colours import BLUE, INK
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.progress import progress_bar

SEED = 2019
FIGURE = {"rotation": "Fig. 3", "translation": "Fig. 4"}
TRUTH = "true X"
CLEARLY, DIFFERENT = 1.01, 1.1  # what is worse, or differs quite a lot, must be by more than 1 % or 10 %
ROUNDING = 1e-13  # rad and m, below which an error is rounding


def rows(full: bool) -> Iterator[dict[str, Any]]:
    levels = LEVELS if full else LEVELS[[0, 5, 10]]
    repeats, pairs = (10, 1000) if full else (3, 100)
    methods = [method for method in METHODS if full or method != "zhao"]
    rng = np.random.default_rng(SEED)
    with progress_bar("levels", len(KINDS) * len(levels), "levels") as advance:
        for kind in KINDS:
            for level in levels:
                data = disturbed(exact(repeats, pairs, rng), kind, level, rng)
                noise = assumed(kind, level)
                least = error_62(uq.METHODS["gwak"].estimate(data.A, data.B).X, data)
                about = {"noise": kind, "noise_s": level, "pairs": pairs}
                every = np.ones(repeats, dtype=bool)
                yield about | {"method": TRUTH} | scores(data.X, every, data, least) | {"ms": 0.0}
                for method in methods:
                    started = time.perf_counter()
                    X, ok = estimated(method, data.A, data.B, noise)
                    ms = 1e3 * (time.perf_counter() - started) / repeats
                    yield about | {"method": method} | scores(X, ok, data, least) | {"ms": ms}
                advance(1)


def noise_rows(full: bool) -> Iterator[dict[str, float]]:
    """(63) as rotation vectors: standard deviation per axis over ``s / sqrt(2)``, and the largest correlation of two
    axes.
    """
    rng = np.random.default_rng(SEED)
    draws = 200_000 if full else 5_000
    for level in LEVELS:
        T = np.zeros((1, draws, 4, 4))
        T[..., :4, :4] = np.eye(4)
        R = disturbed(Data(T, T, T[:, :1]), "rotation", level, rng).A[0, :, :3, :3]
        theta = logarithm(R)
        ratio = float(np.sqrt(2 * (theta**2).mean())) / level
        correlation = np.abs(np.asarray(np.corrcoef(theta.T))[np.triu_indices(3, 1)]).max()
        yield {"noise_s": level, "sd_over_derived": ratio, "largest_correlation": float(correlation), "draws": draws}


def measure(full: bool) -> dict[str, pd.DataFrame]:
    return {"errors": pd.DataFrame(list(rows(full))), "noise_63": pd.DataFrame(list(noise_rows(full)))}


# ----------------------------------------------------------------------------------------------- from the tables


class Grid(NamedTuple):
    """One quantity of the methods that were run, at the levels of one kind of noise."""

    methods: list[str]
    levels: Array  # (l,)
    values: Array  # (m, l)

    def of(self, method: str) -> Array:
        return np.asarray(self.values[self.methods.index(method)])

    def among(self, names: Sequence[str]) -> Grid:
        kept = [name for name in names if name in self.methods]
        return Grid(kept, self.levels, np.array([self.of(name) for name in kept]))

    def times_least(self, method: str) -> float:
        """Its value over the least at the same level, median over levels."""
        return float(np.median(self.of(method) / self.values.min(axis=0)))


def grid(errors: pd.DataFrame, kind: str, column: str) -> Grid:
    table = errors[(errors.noise == kind) & (errors.method != TRUTH)]
    wide = table.pivot(index="method", columns="noise_s", values=column)
    return Grid([str(name) for name in wide.index], wide.columns.to_numpy(dtype=float), wide.to_numpy(dtype=float))


def words(levels: Sequence[float] | Array) -> str:
    return ", ".join(f"{level:.0e}".replace("e-0", "e-") for level in levels) if len(levels) else "none"


def findings(tables: Tables) -> str:
    errors, noise = tables["errors"], tables["noise_63"]
    truth = errors[errors.method == TRUTH]
    repeats, pairs, levels = int(truth.repeats.iloc[0]), int(truth.pairs.iloc[0]), truth.noise_s.nunique()
    return "\n\n".join(
        [
            f"{pairs:,} motions, {repeats} repeats at each of {levels} levels from {words([truth.noise_s.min()])} to "
            f"{words([truth.noise_s.max()])}, rad for rotation (entries of R) and m for translation.",
            *_of_noise(noise, errors),
            *_tables(errors),
            *_statements(errors),
            *_convergence(errors),
        ]
    )


def _of_noise(noise: pd.DataFrame, errors: pd.DataFrame) -> list[str]:
    small = noise[noise.noise_s <= 0.01]
    uncertain = 1 / np.sqrt(6 * small.draws.iloc[0])
    off = float((small.sd_over_derived - 1).abs().max())
    largest = noise.sort_values("noise_s").iloc[-1]
    holds = "as derived" if off <= 4 * uncertain + 1e-3 else "not as derived"
    truth = errors[errors.method == TRUTH]
    middle, most = truth.excess_percent.median(), truth.excess_percent.max()
    slopes = [
        float(np.polyfit(np.log(rows.noise_s), np.log(rows.error_62), 1)[0])
        for _, rows in errors.groupby(["noise", "method"])
    ]
    return [
        f"**The noise.** (63) gives rotation vectors of deviation s/sqrt(2) per axis: up to s = 0.01 measured over "
        f"derived differs from 1 by {off:.2%} at most (Monte Carlo: {uncertain:.2%}), {holds}; at "
        f"s = {largest.noise_s:g} it is {largest.sd_over_derived:.4f}. The largest "
        f"correlation of two axes is {noise.largest_correlation.max():.3f}.",
        f"**(62) is a measure of the noise.** The true X, without any error, has a (62) that is {middle:.3f} % above "
        f"the least possible one (median over levels; largest {most:.3f} %). Fitted over all levels, (62) grows as "
        f"the noise to the power of {min(slopes):.3f} to {max(slopes):.3f}, method by method.",
    ]


def _tables(errors: pd.DataFrame) -> list[str]:
    parts = [
        "Per method, medians over the levels: (62) above the least possible, which `gwak` reaches by construction, and "
        "root mean square error per axis of X over the noise s.",
    ]
    header = ("method", "(62) above the least, %", "rotation / s", "translation / s")
    for kind, units in (("rotation", ("rad", "m")), ("translation", ("rad/m", "m/m"))):
        excess = grid(errors, kind, "excess_percent")
        gains = [grid(errors, kind, f"{name}") for name in ("rotation_rms_rad", "translation_rms_m")]
        lines = []
        for method in METHODS:
            if method not in excess.methods:
                continue
            cells = []
            for gain in gains:
                error = gain.of(method)
                rounded = np.median(error) < ROUNDING
                cells.append("rounding" if rounded else f"{np.median(error / gain.levels):.2g}")
            lines.append((f"`{method}`", f"{np.median(excess.of(method)):.3f}", *cells))
        named = (*header[:2], *(f"{h}, {u}" for h, u in zip(header[2:], units, strict=True)))
        parts += [f"**{FIGURE[kind]}, noise of {kind}:**", markdown(named, lines)]
    return parts


def _statements(errors: pd.DataFrame) -> list[str]:
    return ["**What the paper says of these figures**", "\n".join(f"- {line}" for line in statements(errors))]


def statements(errors: pd.DataFrame) -> Iterator[str]:
    every = grid(errors, "rotation", "excess_percent")
    paper = every.among(PAPER)
    best = [paper.methods[k] for k in paper.values.argmin(axis=0)]
    won = sum(method in OPTIMISING for method in best)
    counts = ", ".join(f"`{name}` {best.count(name)}" for name in dict.fromkeys(best))
    medians = {name: float(np.median(every.of(name))) for name in OPTIMISING if name in every.methods}
    nearest = min(medians, key=lambda name: medians[name])
    deviation = np.median(grid(errors, "rotation", "excess_se_percent").of(nearest))
    yield (
        f"*The optimisation methods have the least (62) in Fig. 3.* {verdict(won, len(best))}: of the paper's methods, "
        f"one of {', '.join(medians)} is least at {won} of {len(best)} levels ({counts}). The nearest of them, "
        f"`{nearest}`, is {medians[nearest]:.2g} % above the least (62) that any X has (median over levels; standard "
        f"deviation of one level {deviation:.1g} %). What minimises (62) itself is `gwak`."
    )
    far = every.of(FINITE[1])
    table = grid(errors, "rotation", "translation_rms_m").among(PAPER)
    others = table.among([method for method in table.methods if method not in FINITE])
    last = int((table.of(FINITE[1]) > others.values.max(axis=0)).sum())
    yield (
        f"*4DPA is comparable.* {verdict((far <= 1).sum(), len(far))} of (62): at d = 1e4 within 1 % of the least "
        f"at {(far <= 1).sum()} of {len(far)} levels of Fig. 3 (largest {far.max():.2g} %). Its translation error is "
        f"{table.times_least(FINITE[1]):.1f} times the least of the paper's methods (median over levels), and above "
        f"that of each of them at {last} of {len(far)} levels."
    )
    for column, name in (("error_62", "(62)"), ("translation_rms_m", "the translation error of X")):
        table = grid(errors, "translation", column).among(PAPER)
        others = table.among([method for method in table.methods if method != FINITE[0]])
        worst = table.levels[table.of(FINITE[0]) > CLEARLY * others.values.max(axis=0)]
        yield (
            f"*d = 1e3 is the worst in Fig. 4*, by {name}. {verdict(len(worst), len(table.levels))}: it is more than "
            f"1 % worse than every other at {len(worst)} of {len(table.levels)} levels ({words(worst)})."
        )
    over = [grid(errors, "translation", "excess_percent").of(method).max() for method in FINITE[2:]]
    times = grid(errors, "translation", "translation_rms_m").among(PAPER).times_least(FINITE[2])
    yield (
        f"*d = 1e5 and 1e6 are close to the least in Fig. 4.* {verdict(max(over) <= 1, 1)} of (62), which is "
        f"{over[0]:.2g} % and {over[1]:.2g} % above it at most; their translation error is {times:.2f} times "
        "the least (median)."
    )
    for kind in KINDS:
        of_62, of_t = (
            Grid(table.methods, table.levels, table.values.max(axis=0) / table.values.min(axis=0))
            for table in (grid(errors, kind, column).among(FINITE) for column in ("error_62", "translation_rms_m"))
        )
        some, more = (ratio.levels[ratio.values > DIFFERENT] for ratio in (of_62, of_t))
        yield (
            f"*The performance differs quite a lot with d* ({FIGURE[kind]}). {verdict(len(more), len(of_t.levels))}: "
            f"over d = 1e3 to 1e6 the translation error differs by a factor of up to {of_t.values.max():.3g}, by more "
            f"than 10 % at {len(more)} of {len(of_t.levels)} levels ({words(more)}); (62) by up to "
            f"{of_62.values.max():.3g}, by more than 10 % at {len(some)} ({words(some)})."
        )
    apart = []
    for kind in KINDS:
        table = grid(errors, kind, "translation_rms_m")
        apart.append(float(np.abs(table.of(FINITE[3]) / table.of(LIMIT) - 1).max()))
    yield f"The limit, without d, differs from d = 1e6 by {max(apart):.1%} at most in the translation error."


def verdict(held: int, of: int) -> str:
    return "Holds" if held == of else "Does not hold" if held == 0 else "Holds at some levels"


def _convergence(errors: pd.DataFrame) -> list[str]:
    lost = (errors.repeats - errors.converged).groupby(errors.method).sum()
    lost = lost[lost > 0]
    of = int(errors[errors.method == TRUTH].repeats.sum())
    said = ", ".join(f"`{name}` {count} of {of}" for name, count in lost.items()) or "none"
    ms = errors[errors.method != TRUTH].groupby("method").ms.median()
    slow = ms.drop(LIMIT).sort_values(ascending=False).head(2) / ms[LIMIT]
    return [
        f"Not converged and left out: {said}. Slowest: "
        + " and ".join(f"`{name}` with {ratio:,.0f} times" for name, ratio in slow.items())
        + " the time of 4DPA's limit.",
    ]


# ------------------------------------------------------------------------------------------------------- figure

_PANELS = (
    ("error_62", "error (62)"),
    ("excess_percent", "(62) above\nthe least, %"),
    ("rotation_rms_rad", "rotation error\nof X / s"),
    ("translation_rms_m", "translation error\nof X / s"),
)
# what is below is not drawn: rounding, and what is told of exact data
_FLOORS = {"excess_percent": 1e-4, "rotation_rms_rad": 3e-3, "translation_rms_m": 5e-3}


def look(method: str) -> dict[str, Any]:
    """Finite d carry their exponents as markers, 1e4 to 1e6 by turns as they coincide, in the rings of the limit."""
    if method not in SCALES:
        open_ring = {"markersize": 7.0, "markerfacecolor": "white", "markeredgewidth": 0.8, "zorder": 3}
        return style(method) | {"markersize": 3.5, "linewidth": 0.9} | (open_ring if method == LIMIT else {})
    k = FINITE.index(method)
    own = (
        {"color": INK, "linewidth": 1.1, "markevery": slice(0, 4)}
        if k == 0
        else {"color": BLUE, "linewidth": 0.9, "markevery": (k - 1, 3)}
    )
    return own | {"marker": f"${3 + k}$", "markersize": 5.5, "markeredgewidth": 0.2, "linestyle": "-.", "zorder": 4}


def figures(tables: Tables) -> Mapping[str, Figure]:
    errors = tables["errors"]
    figure = canvas(8.6)
    axes = figure.subplots(len(_PANELS), 2, sharex=True, sharey="row", height_ratios=(0.7, 1.1, 0.9, 1.0))
    for column, kind in enumerate(KINDS):
        for axis, (quantity, label) in zip(axes[:, column], _PANELS, strict=True):
            _draw(axis, errors[errors.noise == kind], quantity)
            axis.set_ylabel("" if column else label, fontsize=TEXT)
            plain(axis)
        axes[0, column].set_title(f"{FIGURE[kind]}: noise of {kind}", fontsize=TEXT)
        axes[-1, column].set_xlabel("noise s of (63), rad" if column == 0 else "noise s of (64), m", fontsize=TEXT)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, fontsize=SMALL, frameon=False)
    return {"figures_3_4": finished(figure)}


def _draw(axis: Axes, errors: pd.DataFrame, quantity: str) -> None:
    """Means over the repeats; bars and bands are described in the caption."""
    floor = _FLOORS.get(quantity, 0.0)
    for method in METHODS:
        rows = errors[errors.method == method].sort_values("noise_s")
        if rows.empty:
            continue
        unit = rows.noise_s if quantity.endswith(("rad", "_m")) else 1.0
        value = rows[quantity] / unit
        value = value.where(value >= floor)
        axis.plot(rows.noise_s, value, label=method, **look(method))
        se = {"excess_percent": "excess_se_percent"}.get(quantity, f"{quantity}_se")
        if quantity == "error_62":
            axis.fill_between(
                rows.noise_s, rows.error_62_min, rows.error_62_max, color=look(method)["color"], alpha=0.1
            )
        else:
            low = (value - rows[se] / unit).clip(lower=floor)
            axis.vlines(rows.noise_s, low, value + rows[se] / unit, color=look(method)["color"], linewidth=0.7)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.yaxis.set_minor_formatter(NullFormatter())
    if floor:
        axis.set_ylim(bottom=floor)


STUDY = Study("figures_3_4", measure, findings, figures, packages=("cvxpy",))
