"""The text on two synchronised streams: the offset, the source of the poses, the poses left out, and remarks."""

from __future__ import annotations

from ...core.limits import MAX_LISTED
from ...core.presentation.document import Block, Caution, Document, Heading, Paragraph, document_of
from ...core.presentation.numbers import concise, digits
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M, MS_PER_S
from .result import Synchronised

NAMES = {"so4": "on SO(4), (37)-(38)", "geodesic": "along the geodesic of SE(3)"}


@document_of.register(Synchronised)
def synchronised_document(sync: Synchronised) -> Document:
    """The offset first, then what the poses were made of, what was left out and what to know."""
    return [
        Paragraph(headline(sync)),
        *map(Caution, sync.warnings),
        [Paragraph(sentence) for sentence in offset_sentences(sync)],
        [Paragraph(sentence) for sentence in _made_of(sync)],
        _left_out(sync),
        *map(Paragraph, sync.notes),
        Paragraph(_scope(sync)),
    ]


def headline(sync: Synchronised) -> str:
    """Poses and offset in one sentence."""
    what = f"{sync.poses.n} pose pairs" if sync.stops is None else f"{sync.stops} stops, one averaged pose pair each"
    if sync.origin == "given":
        return f"{what}; time offset {MS_PER_S * sync.offset:.6g} ms as given (robot_time = camera_time + offset)."
    return (
        f"{what}; time offset {concise(MS_PER_S * sync.offset, MS_PER_S * sync.offset_std, 'ms')} "
        f"(robot_time = camera_time + offset), {sync.origin}."
    )


def offset_sentences(sync: Synchronised) -> list[str]:
    """Describe how the offset and its standard deviation were found."""
    found = []
    if sync.correlation is not None and sync.correlation.found:
        found.append(
            f"The angular speeds of robot and camera correlate by {sync.correlation.heights[0]:.2f} at "
            f"{MS_PER_S * (sync.correlation.peaks[0] + sync.shift):.4g} ms (chance stays below "
            f"{sync.correlation.needed:.2f}); from there the offset was refined jointly with X and W."
        )
    if sync.origin.startswith("estimated"):
        more = ""
        if sync.model_std is not None and sync.offset_std > 1.2 * sync.model_std and sync.origin == "estimated":
            more = (
                f" If all poses were independent it would be {digits(MS_PER_S * sync.model_std, 2)} ms; their "
                "residuals say otherwise"
            )
            shared = f": neighbours are correlated, which makes it {digits(sync.growth, 2)} times larger"
            more += f"{shared if sync.growth > 1.05 else ''}."
        found.append(f"Standard deviation of the offset: {digits(MS_PER_S * sync.offset_std, 2)} ms.{more}")
    if sync.stops is not None:
        found.append("At a stop nothing moves: the time offset hardly matters for these poses.")
    return found


def _made_of(sync: Synchronised) -> list[str]:
    robot, camera = (f"{1.0 / interval:.4g} Hz" for interval in sync.intervals)
    lines = [f"Rates: robot {robot}, camera {camera} (median)."]
    if sync.stops is None:
        other = "camera" if sync.side == "robot" else "robot"
        turn, move = DEG_PER_RAD * sync.interpolation_error[0], MM_PER_M * sync.interpolation_error[1]
        lines.append(
            f"The {sync.side} was interpolated at the times of the {other} {NAMES[sync.interpolation]}, never over "
            f"more than {sync.max_gap:.3g} s; that misses the motion by about {digits(turn, 2)} deg and "
            f"{digits(move, 2)} mm (root mean square)."
        )
    return lines


def _left_out(sync: Synchronised) -> list[Block]:
    if not sync.left_out:
        return [] if sync.stops is not None else [Paragraph("No pose was left out.")]
    listed = [Paragraph(str(part), indent="  ", hang="    ") for part in sync.left_out[:MAX_LISTED]]
    more = len(sync.left_out) - MAX_LISTED
    rest = [Paragraph(f"and {more} more groups; see left_out", indent="  ")] if more > 0 else []
    return [Heading("Left out:"), *listed, *rest]


def _scope(sync: Synchronised) -> str:
    carried = (
        "calibrate() takes the uncertainty of the offset into the covariance of X (methods efficient and ml). "
        if sync.offset_std > 0 and sync.stops is None
        else ""
    )
    if sync.noise is not None:
        carried += "Give it the noise of the pose pairs, `noise` of this result, not that of the samples. "
    return (
        f"{carried}Not covered: clocks that run at different rates, delays that change while recording. A delay that "
        "is constant is part of the offset."
    )
