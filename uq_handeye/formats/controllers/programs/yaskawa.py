"""Positions of Yaskawa (Motoman) jobs, ``.jbi``: ``C00000=x,y,z,Rx,Ry,Rz`` below ``///RECTAN``, in mm and degrees.

Rotations about the fixed axes X, Y, Z. Source: Yaskawa, DX and YRC Options Instructions, Data Transmission: job data
format, position data ``///POSTYPE``, ``///RECTAN``, ``///RCONF``, ``///PULSE``. Positions in pulses are joints.
External and base axes (``EC``, ``BC``) are no poses.
"""

from __future__ import annotations

import re

from ....errors import InputError
from ...contents import Contents
from ..forms import CONTROLLERS
from ..tables import HELP
from .found import Found, contents_of

_POSITION = re.compile(r"\s*((?:BC|EC|BP|EX|[CP])\d+)\s*=\s*([^=]*)", re.IGNORECASE)
_IS_JOB = re.compile(r"^[ \t]*(?:/JOB\b|///RECTAN|///PULSE|///POSTYPE|[CP]\d{4,5}\s*=)", re.MULTILINE)


def is_yaskawa(head: str) -> bool:
    """Return whether a text is a job or its position data."""
    return bool(_IS_JOB.search(head))


def read_yaskawa(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    found = Found()
    kind = ""  # pulses are whole numbers, positions have decimals
    frames = []
    tool = frame = ""
    for number, line in enumerate(text.splitlines(), start=1):
        small = line.strip().lower()
        if small.startswith("//inst"):
            break
        if small.startswith(("///rectan", "///pulse")):
            kind = small[3:]
        elif small.startswith(("///tool", "///user")):
            tool, frame = (small[3:], frame) if small.startswith("///tool") else (tool, small[3:])
        elif small.startswith("///postype"):
            frames.append(line.strip()[10:].strip())
            kind = "pulse" if "pulse" in small else "rectan"
        elif (match := _POSITION.fullmatch(line.rstrip())) is not None:
            if match[1][0].upper() in "BE":
                continue
            if kind.startswith("pulse") or (not kind and "." not in match[2]):
                found.joints += 1
                continue
            values = [value.strip() for value in match[2].split(",")]
            if len(values) not in (6, 7, 8):
                raise InputError(
                    f"{name}, line {number}: expected x, y, z, Rx, Ry, Rz of {match[1]}, got {len(values)} numbers; "
                    f"{HELP}."
                )
            if tool or frame:
                found.tools.append(" ".join(f"{tool} {frame}".upper().split()))
            found.add(number, match[1], values[:6], name)
    others = sorted({frame for frame in frames if frame.upper() not in ("ROBOT", "BASE", "PULSE")})
    if others:
        found.notes.append(f"positions in the frame {', '.join(others)} of the job, not in the base of the robot")
    return contents_of(found, name, CONTROLLERS["yaskawa"])
