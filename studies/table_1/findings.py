"""Findings of `table_1` in words, from its tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from studies.common.study import Tables, markdown

SPEED = (("High", 5.0), ("Medium", 15.0), ("Low", 50.0), ("Very Low", np.inf))  # time / that of the fastest
ACCURACY = (("High", 1.25), ("Medium", 2.0), ("Low", np.inf))  # predicted deviation / bound, geometric mean
RATIOS = ["rotation_over_bound", "translation_over_bound"]
OURS = ("li", "shah", "efficient", "ml")  # beneath the paper's fifteen


def class_of(value: float, rule: Sequence[tuple[str, float]]) -> str:
    return next(name for name, limit in rule if value < limit)


def rule_text(rule: Sequence[tuple[str, float]]) -> str:
    return ", ".join(f"{name} below {limit:g}" for name, limit in rule[:-1]) + f", else {rule[-1][0]}"


def summary(tables: Tables) -> pd.DataFrame:
    """Per method: geometric means over the cases, mean NEES, where it lies, and classes.

    ``ratio`` is that of the further geometries, ``least`` and ``largest`` of one of them; ``drawn`` of the draws.
    """
    accuracy, rows = tables["accuracy"], []
    further = ratios(tables["geometries"][tables["geometries"]["geometry"] > 0])
    for name in tables["about"]["method"]:
        cells = accuracy[accuracy["method"] == name]
        inside = cells["nees"].between(cells["nees_low"], cells["nees_high"])
        turn, shift = (float(np.exp(np.log(cells[column]).mean())) for column in RATIOS)
        rows.append(
            {
                "method": name,
                "cases": len(cells),
                "rotation": turn,
                "translation": shift,
                "drawn": float(np.sqrt(turn * shift)),
                "ratio": float(np.exp(np.log(further[name]).mean())),
                "least": float(further[name].min()),
                "largest": float(further[name].max()),
                "nees": float(np.average(cells["nees"], weights=cells["trials"])),
                "inside": int(inside.sum()),
                "failed": int(cells["failed"].sum()),
            }
        )
    table = pd.DataFrame(rows).merge(tables["times"], on="method").merge(tables["exact"], on="method")
    table["speed"] = [class_of(x, SPEED) for x in table["one_over_fastest"]]
    table["accuracy"] = [class_of(x, ACCURACY) for x in table["ratio"]]
    return table.merge(tables["about"], on="method").set_index("method")


def ratios(geometries: pd.DataFrame) -> pd.Series:
    """Predicted standard deviation over bound by method and geometry: geometric mean over cases, rotation and
    translation.
    """
    logarithms = geometries.assign(logarithm=np.log(geometries[RATIOS]).mean(axis=1))
    found: pd.Series = np.exp(logarithms.groupby(["method", "geometry"])["logarithm"].mean())
    return found


def findings(tables: Tables) -> str:
    table = summary(tables)
    return "\n\n".join(
        [
            _measured(table, tables["accuracy"]),
            _classes(table, tables["geometries"], tables["paper_times"]),
            _by_case(tables["accuracy"], tables["geometries"], table["structure"]),
            _tools(table),
        ]
    )


def _measured(table: pd.DataFrame, accuracy: pd.DataFrame) -> str:
    rows = [
        [
            f"`{name}`",
            "" if pd.isna(row["year"]) else f"{row['year']:.0f}",
            row["structure"],
            row["form"],
            f"{row['largest_error_rad_m']:.0e}",
            f"{row['rotation']:.2f}",
            f"{row['translation']:.2f}",
            f"{row['nees']:.2f}",
            f"{row['inside']} of {row['cases']}",
        ]
        for name, row in table.iterrows()
    ]
    most = accuracy.sort_values("trials").iloc[-1]
    problems, draws = int(table["problems"].max()), int(most["trials"])
    outside = accuracy[~accuracy["nees"].between(accuracy["nees_low"], accuracy["nees_high"])]
    where = ", ".join(f'`{row.method}` in "{row.case}" ({row.nees:.2f})' for row in outside.itertuples())
    by_chance = 0.001 * len(accuracy)
    failed = int(table["failed"].sum())
    return (
        "## All methods, measured\n\n"
        f"Exact data: largest error (rad, m) on {problems} problems without noise. Rotation, translation: RMS error "
        "of the draws over that of the Cramer-Rao bound, geometric mean over the cases "
        f"({accuracy['case'].nunique()}; `li` and `shah` need poses: {int(table['cases'].min())}). NEES: mean of "
        f"`e^T Sigma^-1 e` over up to {draws:,} draws per case, 6 if the predicted covariance is consistent; 99.9 % of "
        f"such means lie between {most['nees_low']:.2f} and {most['nees_high']:.2f} at {draws:,} draws (wider for the "
        "fewer of `zhao` and `heller`); last column: in how many cases it does.\n\n"
        + markdown(
            ["method", "year", "structure", "form", "exact data", "rotation", "translation", "NEES", "inside"], rows
        )
        + "\n\nUncertainty: in the paper's table only `nguyen` has one. Here all have: the mean NEES is inside its "
        f"99.9 % interval in {len(accuracy) - len(outside)} of {len(accuracy)} cells (by chance about {by_chance:.1f} "
        f"would be outside). " + (f"Outside: {where}. " if len(outside) else "") + f"{failed} estimates failed."
    )


def _classes(table: pd.DataFrame, geometries: pd.DataFrame, paper_times: pd.DataFrame) -> str:
    rows = [
        [
            f"`{name}`",
            row["paper_speed"] or "",
            f"{row['speed']} ({row['one_over_fastest']:.3g}; {row['batch_over_fastest']:.3g})",
            row["paper_accuracy"] or "",
            f"{row['accuracy']} ({row['ratio']:.2f}; {row['least']:.2f} to {row['largest']:.2f}; {row['drawn']:.2f})"
            + ("" if row["cases"] == table["cases"].max() else f", of {row['cases']} cases"),
            row["paper_uncertainty"] or "",
            "yes" if np.isfinite(row["nees"]) else "no",
        ]
        for name, row in table.iterrows()
    ]
    printed = table[table["paper_speed"] != ""]
    other = {
        what: [f"`{name}`" for name, row in printed.iterrows() if row[f"paper_{what}"] != row[what]]
        for what in ("speed", "accuracy")
    }
    published = _comparable(table)
    ratio = {str(name): float(x) for name, x in table["ratio"].items()}
    count = geometries.loc[geometries["geometry"] > 0, "geometry"].nunique()
    best, worst = str(published["ratio"].idxmin()), str(published["ratio"].idxmax())
    of_4dpa = "" if worst == "4dpa" else f"; `4dpa` has {ratio['4dpa']:.2f}"
    return (
        "## Classes\n\n"
        f"Speed: processor time of one problem over that of the fastest, {rule_text(SPEED)}; in brackets that ratio, "
        "and the same in a batch. Accuracy: standard deviation over that of the bound, predicted to first order, "
        f"geometric mean over {count} random geometries of each case, over the cases, rotation and translation, "
        f"{rule_text(ACCURACY)}; in brackets that ratio, its range over single geometries, and the RMS error over "
        "bound of the draws, which are of one more geometry. `efficient` and `ml` have the bound itself as their "
        "prediction: of them the last number is the measured one. The paper states no rule; 4DPA has no row in its "
        "table.\n\n"
        + markdown(
            ["method", "speed: paper", "measured", "accuracy: paper", "measured", "uncertainty: paper", "here"], rows
        )
        + f"\n\nThe classes differ in speed for {len(other['speed'])} of {len(printed)} methods "
        f"({_list(other['speed'])}), in accuracy for {len(other['accuracy'])} ({_list(other['accuracy'])}). Of the "
        f"published methods that run on all cases `{best}` is nearest to the bound ({ratio[best]:.2f}), `{worst}` "
        f"farthest ({ratio[worst]:.2f}){of_4dpa}. "
        f"{_separated(table)}\n\n{_of_one_geometry(table, geometries)}\n\n{_order(printed)}\n\n"
        f"{_against_its_own_times(table, paper_times)}"
    )


def _of_one_geometry(table: pd.DataFrame, geometries: pd.DataFrame) -> str:
    """Say what the geometry decides of the class, and what is drawn of it against what is predicted."""
    single = ratios(geometries[geometries["geometry"] > 0])
    own = table["accuracy"]
    varied = [
        f"`{name}`" for name in table.index if len({class_of(x, ACCURACY) for x in single[name]} | {own[name]}) > 1
    ]
    drawn = [f"`{name}`" for name in table.index if class_of(table.loc[name, "drawn"], ACCURACY) != own[name]]
    return (
        f"One geometry alone need not give the same class: among single geometries it differs for {len(varied)} of "
        f"{len(table)} methods ({_list(varied)}); that of the draws differs for {len(drawn)} ({_list(drawn)})."
    )


def _list(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"


def _comparable(table: pd.DataFrame) -> pd.DataFrame:
    """The published methods that were run on all cases."""
    found: pd.DataFrame = table[(table["cases"] == table["cases"].max()) & ~table.index.isin(["efficient", "ml"])]
    return found


def _order(printed: pd.DataFrame) -> str:
    """Compare, independently of where our classes end, the pairs of methods that Table I and the measurement rank
    alike.
    """
    said = []
    for what, column, rule in (("speed", "one_over_fastest", SPEED), ("accuracy", "ratio", ACCURACY)):
        order = [name for name, _ in rule]
        rank, value = [order.index(word) for word in printed[f"paper_{what}"]], printed[column].to_numpy()
        better = [value[a] < value[b] for a in range(len(rank)) for b in range(len(rank)) if rank[a] < rank[b]]
        said.append(f"{what}, {sum(better)} of {len(better)}")
    return (
        "Whatever the limits of the classes, pairs of methods that Table I puts into different ones and that are in "
        f"the same order here: {'; '.join(said)}."
    )


def _separated(table: pd.DataFrame) -> str:
    means = {
        str(kind): (float(np.exp(np.log(rows["ratio"]).mean())), len(rows))
        for kind, rows in _comparable(table).groupby("structure")
    }
    return (
        "Geometric mean of the ratio by structure (number of methods): "
        + ", ".join(f"{kind} {x:.2f} ({n})" for kind, (x, n) in means.items())
        + "."
    )


def _against_its_own_times(table: pd.DataFrame, paper_times: pd.DataFrame) -> str:
    """Pairs of methods whose classes in Table I contradict the times in Tables II and III."""
    first = paper_times[paper_times["N"] == paper_times["N"].min()].set_index("method")["seconds"]
    order = [name for name, _ in SPEED]
    words = {str(name): str(word) for name, word in table["paper_speed"].items()}
    classes = {name: order.index(words[name]) for name in first.index if words[name]}
    wrong, compared = [], 0
    for fast in classes:
        for slow in classes:
            if classes[fast] < classes[slow]:
                compared += 1
                if first[fast] > first[slow]:
                    wrong.append((first[fast] / first[slow], fast, slow))
    text = (
        f"Of {compared} pairs of methods that Table I puts into different classes of speed and Tables II and III time, "
        f'{len(wrong)} have the "faster" one slower in the first case there.'
    )
    if wrong:
        factor, fast, slow = max(wrong)
        text += f" Most so: `{fast}` ({words[fast]}) takes {factor:.1f} times as long as `{slow}` ({words[slow]})."
    return text


def _by_case(accuracy: pd.DataFrame, geometries: pd.DataFrame, structure: pd.Series) -> str:
    cases = list(accuracy["case"].unique())
    cells = {
        (row.method, row.case): f"{row.rotation_over_bound:.2f}, {row.translation_over_bound:.2f}; {row.nees:.2f}"
        for row in accuracy.itertuples()
    }
    rows = [
        [f"`{name}`", *(cells.get((name, case), "needs poses") for case in cases)]
        for name in accuracy["method"].unique()
    ]
    hard = cases[-1]
    of_hard = accuracy[(accuracy["case"] == hard)].set_index("method")["translation_over_bound"]
    published = of_hard.drop(["efficient", "ml"], errors="ignore")
    parts = {kind: published[structure[published.index] == kind] for kind in ("separated", "simultaneous")}
    said = "; ".join(
        f"{kind} methods {x.min():.2f} (`{x.idxmin()}`) to {x.max():.2f} (`{x.idxmax()}`)" for kind, x in parts.items()
    )
    untold = parts["separated"].drop("nguyen")
    worse = parts["separated"].min() > parts["simultaneous"].min()
    trials = int(accuracy["trials"].max())
    agreement = _agreement(accuracy, geometries)
    return (
        "## Case by case\n\n"
        f"Of the draws: RMS error over bound of rotation, translation; mean NEES. One standard error of a ratio "
        f"from {trials:,} draws is about {100 / np.sqrt(6 * trials):.1f} to {100 / np.sqrt(2 * trials):.1f} %.\n\n"
        + markdown(["method", *cases], rows)
        + f"\n\n{agreement}"
        + '\n\nThe ranking depends on the case. The paper says that separated methods "can not produce good enough '
        f'results" when translations are more accurate than rotations, as in "{hard}". Translation error over bound '
        f"there: {said}. "
        + (
            "The best of the separated ones is worse than the best of the others: the sentence holds here."
            if worse
            else "The best of the separated ones is not worse than the best of the others: the sentence does not hold "
            "here."
        )
        + f" `nguyen` alone of these is told the noise; without it the best separated one has {untold.min():.2f} "
        f"(`{untold.idxmin()}`). `4dpa`: {published['4dpa']:.2f}. {_further(geometries, hard, structure)}"
    )


def _agreement(accuracy: pd.DataFrame, geometries: pd.DataFrame) -> str:
    """Drawn over predicted standard deviations in the geometry of the draws."""
    keys = ["case", "method"]
    both = accuracy.merge(geometries[geometries["geometry"] == 0], on=keys, suffixes=("", "_predicted"))
    share = np.concatenate([both[name] / both[f"{name}_predicted"] for name in RATIOS])
    return (
        f"Over what is predicted to first order for the same geometry, these RMS errors are {share.min():.2f} to "
        f"{share.max():.2f} (median {np.median(share):.2f})."
    )


def _further(geometries: pd.DataFrame, case: str, structure: pd.Series) -> str:
    """Count the further geometries in which the best separated method has the larger translation error."""
    chosen = geometries[(geometries["case"] == case) & (geometries["geometry"] > 0)]
    chosen = chosen[~chosen["method"].isin(["efficient", "ml"])]
    kind = chosen["method"].map(structure)
    best = chosen["translation_over_bound"].groupby([chosen["geometry"], kind]).min().unstack()
    told = chosen["method"] == "nguyen"
    untold = chosen["translation_over_bound"][~told].groupby([chosen["geometry"], kind]).min().unstack()
    count = [int((of["separated"] > of["simultaneous"]).sum()) for of in (best, untold)]
    return (
        f"In the {len(best)} further geometries, to first order, the best separated method is worse than the best of "
        f"the others in {count[0]}, without `nguyen` in {count[1]}."
    )


def _tools(table: pd.DataFrame) -> str:
    def text(value: object) -> str:
        return str(value).replace("|", "\\|")

    rows = [
        [
            f"`{name}`",
            *(text(row[column]) for column in ("paper_type", "paper_tools")),
            f"{row['structure']}, {row['form']}",
            *(text(row[column]) for column in ("minimises", "reference")),
        ]
        for name, row in table.iterrows()
    ]
    return "## Type and tools\n\n" + markdown(
        ["method", "type: paper", "basic tools: paper", "here", "minimises, as implemented here", "reference"], rows
    )
