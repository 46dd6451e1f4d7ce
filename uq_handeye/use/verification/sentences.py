"""Sentences of the findings about touches. Values are in m."""

from __future__ import annotations

from collections.abc import Sequence

from ...core.limits import MAX_NAMED
from ...core.presentation.numbers import digits
from ...findings import sentence


@sentence("verification.inverted_robot")
def _(rms: float, other: float) -> str:
    return (
        f"The touches differ by {digits(1e3 * rms, 2)} mm (RMS), and by {digits(1e3 * other, 2)} mm if the robot "
        f"poses at "
        "which the points were seen are inverted. They seem to be gripper_T_base. Give base_T_gripper."
    )


@sentence("verification.point_noise_assumed")
def _(sd: float) -> str:
    return (
        "No noise of the seen points is given. That of a camera pose in the calibration is taken, with the robot's "
        f"{digits(1e3 * sd, 2)} mm per axis. Give --point-sd if it is another."
    )


@sentence("verification.tool_hides_bias")
def _(hidden: int, posed: bool) -> str:
    what = "a bias" if hidden == 3 else f"{hidden} of 3 directions of a bias"
    do = (
        "Touch points with the tool in other orientations" if posed else "Give the robot poses at the touches"
    )  # their orientations tell tool and bias apart
    return f"The tool's offset is unknown and hides {what}. {do}, or state what is known of the tool (--tool-sd)."


@sentence("verification.no_scatter")
def _(count: int, tested: bool) -> str:
    touches = "One touch tests" if count == 1 else f"{count} touches test"
    if tested:
        return f"{touches} an offset only. Add touches elsewhere to test the rotation of X and the noise."
    return (
        f"{count} {'touch' if count == 1 else 'touches'} with an unknown tool cannot test the calibration. Add touches."
    )


@sentence("verification.points_differ")
def _(names: Sequence[str], count: int) -> str:
    listed = ", ".join(names[:MAX_NAMED]) + (", ..." if len(names) > MAX_NAMED else "")
    one = len(names) == 1
    return (
        f"{len(names)} of {count} points {'differs' if one else 'differ'} from the calibration more than chance "
        f"allows: "
        f"{listed}. See whether {'it was' if one else 'they were'} seen and touched correctly."
    )
