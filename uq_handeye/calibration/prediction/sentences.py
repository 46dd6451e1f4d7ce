"""Sentences of the findings about predictions. Values are in m and shares."""

from __future__ import annotations

from collections.abc import Sequence

from ...core.presentation.numbers import digits
from ...findings import SHARED, Values, sentence

# Errors of the arm are hardly visible where the data reduce the prior variance by less than this share, on average over
# its groups.
MIN_VISIBLE_SHARE = 0.3


def _local_in_short(v: Values) -> str:
    return f"poses span {digits(100 * v['span'], 2)} % of the reach: local"


@sentence(
    "prediction.local_joints",
    check=SHARED,
    phrase=_local_in_short,
    effect=1.3,
)
def _(span: float, used: float, told: Sequence[Values], here: float, elsewhere: float) -> str:
    shares = ", ".join(f"{digits(100 * of['share'], 2)} % of the {of['group']}" for of in told)
    mean = sum(of["share"] for of in told) / len(told) if told else 0.0
    visible = "are hardly visible in them" if mean < MIN_VISIBLE_SHARE else "are only partly visible in them"
    return (
        f"The poses span {digits(100 * span, 2)} % of the reach and {digits(100 * used, 2)} % of the joint ranges "
        f"(median): errors of the kinematics {visible}. The data determine {shares} (share of the prior variance); the "
        f"target is predicted to {digits(1e3 * here, 2)} mm near these poses, to {digits(1e3 * elsewhere, 2)} mm over "
        "the workspace (RMS). Add poses at other joints (uq-handeye plan --joints), or use the calibration near these "
        "poses only."
    )
