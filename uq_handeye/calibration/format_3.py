"""Result files of format 3, from before there were findings, as those of format 4.

Sentences of those files become findings of the code "stored.text".
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..diagnostics.budget import Budget
from ..diagnostics.scale_errors import PROBED
from ..diagnostics.sentences import LENGTHS

FORMAT_3 = "uq-handeye calibration 3"


def converted(data: dict[str, Any]) -> dict[str, Any]:
    """The parts of a file of format 4; raises whatever comes on a damaged one."""
    analysis, table, estimate = data["analysis"], data["poses"], data["noise_estimate"]
    found = data | {"findings": [_text(text, "caution") for text in data["warnings"]], "shared": []}
    if analysis is not None:
        found["analysis"] = analysis | {
            "diagnostics": _diagnostics(analysis["diagnostics"]),
            "split_half": _halves(analysis["split_half"]),
            "split_in_time": _halves(analysis["split_in_time"]),
            "budget": _budget(analysis["budget"], estimate is not None),
        }
    if table is not None:
        found["poses"] = table | {"flag": [flag.split(" ")[0] for flag in table["flag"]]}
    if estimate is not None:
        found["noise_estimate"] = estimate | {"findings": [_text(text) for text in estimate["statement"]]}
    return found


def _text(text: str, severity: str = "note") -> dict[str, Any]:
    return {"code": "stored.text", "severity": severity, "values": {"text": text}}


def _diagnostics(data: dict[str, Any]) -> dict[str, Any]:
    found = {name: part for name, part in data.items() if name not in ("independent_camera", "focal_covered")}
    of = {words: key for key, words in LENGTHS.items()}
    found["spectrum"] = data["spectrum"] | {"length_of": of[data["spectrum"]["length_of"]]}
    for name, start in (
        ("autocorrelation", "Autocorrelation of the residuals was not tested: "),
        ("normality", "Normality of the residuals was not tested: "),
        ("regression", f"The residuals were not regressed on the {data['item']}s: "),
    ):
        found[name] = _untested(data[name], start)
    covered = (data.get("focal_covered", False), False, False)
    found["probes"] = [
        _with_reason(probe, f"The effect of the {probe['name']} is not known: ") | {"name": name, "covered": known}
        for probe, name, known in zip(data["probes"], PROBED, covered, strict=True)
    ]
    return found


def _with_reason(data: dict[str, Any], start: str) -> dict[str, Any]:
    return data | {"reason": _text(f"{start}{data['reason']}.") if data["reason"] else None}


def _untested(data: dict[str, Any], start: str) -> dict[str, Any]:
    """Add the reason why there is no test, and remove the numbers that stood in its place."""
    found = _with_reason(data, start)
    if found["reason"] is None:
        return found
    return {name: value if name == "reason" or isinstance(value, list) else None for name, value in found.items()}


def _budget(data: dict[str, Any], estimated: bool) -> dict[str, Any]:
    """Add the types of the sources; those files do not say how well their variances are known."""
    sources, parts = tuple(data["sources"]), np.array(data["covariances"], dtype=float)
    types = ("A" if estimated else "B",) * len(sources)
    return data | Budget(sources, parts, np.zeros((0, *parts.shape[1:])), np.eye(4), types).to_dict()


def _halves(data: dict[str, Any]) -> dict[str, Any]:
    text = f"The split-half test ({data['split']}) is not possible: {data['reason']}"
    return data | {"reason": None if data["possible"] else _text(text)}
