"""Findings of the study, from its table."""

from __future__ import annotations

import numpy as np
import pandas as pd

from studies.common.study import Tables, markdown
from studies.headline.rigs import HONEST, MISTAKES

BEYOND = 3.0
RATIOS = ("translation_ratio", "rotation_ratio", "point_ratio")


def worst(rigs: pd.DataFrame) -> pd.Series:
    """The largest of the three errors of each rig, in units of the accuracy stated."""
    return rigs[list(RATIOS)].max(axis=1)


def inflated(rigs: pd.DataFrame) -> pd.Series:
    """The same with the standard uncertainty of Student's t in place of the Gaussian one (JCGM 101, 6.4.9)."""
    dof = rigs["dof"].to_numpy(dtype=float)
    dof = np.where(np.isfinite(dof) & (dof > 2), dof, np.inf)
    return worst(rigs) * np.sqrt(1 - 2 / dof)


def usable(rigs: pd.DataFrame, kinds: tuple[str, ...] | None = None) -> pd.DataFrame:
    kept = rigs[rigs["usable"] == 1]
    return kept if kinds is None else kept[kept["kind"].isin(kinds)]


def line_of(kind: str, of: pd.DataFrame) -> tuple[object, ...]:
    """A row of the table: counts, and the largest ratios."""
    kept = usable(of)
    if not len(kept):
        return (kind, len(of), 0, "", "", "", "", "", "")
    beyond = worst(kept) > BEYOND
    silent = beyond & (kept["lower_limit"] == 0)
    largest = (f"{kept[name].max():.1f}" for name in RATIOS)
    return (
        kind, len(of), len(kept), int(kept["lower_limit"].sum()), f"{beyond.sum()} ({silent.sum()})",
        f"{kept['chance'].sum():.1f}", *largest,
    )  # fmt: skip


def findings(tables: Tables) -> str:
    rigs = tables["rigs"]
    rows = [line_of(str(kind), of) for kind, of in rigs.groupby("kind", sort=False)]
    arms = tuple(kind for kind in HONEST if "arm without" in kind or "accuracy declared" in kind)
    told = tuple(kind for kind in HONEST if kind not in arms and "too small" not in kind)
    parts = [
        markdown(
            ("rigs", "drawn", "usable", "lower limit", "beyond 3 (not a lower limit)", "by chance", "translation",
             "rotation", "point"),
            rows,
        )
    ]  # fmt: skip
    kept = usable(rigs, told)
    beyond = int((worst(kept) > BEYOND).sum())
    by_t = int((inflated(kept) > BEYOND).sum())
    parts.append(
        f"Where the errors are those that the accuracy includes, {beyond} of {len(kept)} usable results are beyond 3, "
        f"and {kept['chance'].sum():.1f} would be by chance; the largest ratio is {worst(kept).max():.1f}. With the "
        f"standard uncertainty of Student's t {by_t} are beyond 3."
    )
    for name, words in (("arm without", "with nothing declared"), ("accuracy declared", "with the accuracy declared")):
        kept = usable(rigs, tuple(kind for kind in arms if name in kind))
        beyond = int((worst(kept) > BEYOND).sum())
        marked = int(kept["lower_limit"].sum())
        parts.append(
            f"Arms without URDF, {words}: {beyond} of {len(kept)} are beyond 3, by up to {worst(kept).max():.0f}; "
            f"{marked} are marked as a lower limit."
        )
    wrong = rigs[rigs["kind"].isin(MISTAKES)]
    parts.append(f"Of {len(wrong)} rigs with a wrong file {int(wrong['usable'].sum())} are called usable.")
    return "\n\n".join(parts)
