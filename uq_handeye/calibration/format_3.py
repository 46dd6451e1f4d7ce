"""Result files of format 3, from before there were findings, as those of format 4.

Sentences of those files become findings of the code "stored.text".
"""

from __future__ import annotations

import math
from typing import Any

from ..diagnostics.sentences import LENGTHS

FORMAT_3 = "uq-handeye calibration 3"
# How the caution began that the headline of a result looks for.
_LOWER_BOUND = "The standard deviations are a lower limit."


def converted(data: dict[str, Any]) -> dict[str, Any]:
    """The parts of a file of format 4; raises whatever comes on a damaged one."""
    analysis, table, estimate = data["analysis"], data["poses"], data["noise_estimate"]
    found = data | {"findings": [_caution(text, analysis) for text in data["warnings"]]}
    if analysis is not None:
        found["analysis"] = analysis | {
            "diagnostics": _diagnostics(analysis["diagnostics"]),
            "split_half": _halves(analysis["split_half"]),
            "split_in_time": _halves(analysis["split_in_time"]),
        }
    if table is not None:
        found["poses"] = table | {"flag": [flag.split(" ")[0] for flag in table["flag"]]}
    if estimate is not None:
        found["noise_estimate"] = estimate | {"findings": [_note(text) for text in estimate["statement"]]}
    return found


def _caution(text: str, analysis: Any) -> dict[str, Any]:
    if text.startswith(_LOWER_BOUND) and analysis is not None:
        focal = analysis["diagnostics"]["probes"][0]
        values = {"translation": math.hypot(*focal["shift"][3:]), "shift_sd": focal["shift_sd"]}
        return {"code": "diagnostics.lower_bound", "severity": "caution", "values": values}
    return {"code": "stored.text", "severity": "caution", "values": {"text": text}}


def _note(text: str) -> dict[str, Any]:
    return {"code": "stored.text", "severity": "note", "values": {"text": text}}


def _diagnostics(data: dict[str, Any]) -> dict[str, Any]:
    found = {"focal_covered": False} | data
    of = {words: key for key, words in LENGTHS.items()}
    found["spectrum"] = data["spectrum"] | {"length_of": of[data["spectrum"]["length_of"]]}
    for name, start in (
        ("autocorrelation", "Autocorrelation of the residuals was not tested: "),
        ("normality", "Normality of the residuals was not tested: "),
        ("regression", f"The residuals were not regressed on the {data['item']}s: "),
    ):
        found[name] = _with_reason(data[name], start)
    found["probes"] = [
        _with_reason(probe, f"The effect of the {probe['name']} is not known: ") for probe in data["probes"]
    ]
    return found


def _with_reason(data: dict[str, Any], start: str) -> dict[str, Any]:
    return data | {"reason": _note(f"{start}{data['reason']}.") if data["reason"] else None}


def _halves(data: dict[str, Any]) -> dict[str, Any]:
    text = f"The split-half test ({data['split']}) is not possible: {data['reason']}"
    return data | {"reason": None if data["possible"] else _note(text)}
