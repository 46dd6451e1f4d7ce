"""What is found about predictions, in words. Values are in m and shares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..findings import sentence
from ..formatting.numbers import digits


@sentence("prediction.local_joints")
def _(span: float, used: float, told: Sequence[Mapping[str, Any]], here: float, elsewhere: float) -> str:
    shares = ", ".join(f"{digits(100 * of['share'], 2)} % of the {of['group']}" for of in told)
    return (
        f"The poses span {digits(100 * span, 2)} % of the reach and {digits(100 * used, 2)} % of the joint ranges "
        f"(median): errors of the kinematics are hardly visible in them. The data tell {shares} (share of the prior "
        f"variance), and predict the target to {digits(1e3 * here, 2)} mm near these poses, to "
        f"{digits(1e3 * elsewhere, 2)} mm over the workspace (RMS). Add poses at other joints (uq-handeye plan with "
        "--joints), or use the calibration near these poses only."
    )
