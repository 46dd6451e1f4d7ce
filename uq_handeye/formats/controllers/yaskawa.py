"""Positions of Yaskawa (Motoman) jobs, ``.jbi``: ``C00000=x,y,z,Rx,Ry,Rz`` below ``///RECTAN``, in mm and degrees.

Rotations about the fixed axes X, Y, Z. Source: Yaskawa, DX and YRC Options Instructions, Data Transmission: job data
format, position data ``///POSTYPE``, ``///RECTAN``, ``///RCONF``, ``///PULSE``. Positions in pulses are joints.
External and base axes (``EC``, ``BC``) are no poses.
"""

from __future__ import annotations

import re

from ...errors import InputError
from .program_text import ProgramPoses, fields_of_list
from .tables import HELP

_POSITION = re.compile(r"\s*((?:BC|EC|BP|EX|[CP])\d+)\s*=\s*([^=]*)", re.IGNORECASE)
IS_YASKAWA = re.compile(r"^[ \t]*(?:/JOB\b|///RECTAN|///PULSE|///POSTYPE|[CP]\d{4,5}\s*=)", re.MULTILINE)


def add_yaskawa_poses(found: ProgramPoses) -> None:
    """Add the poses of a text of Yaskawa."""
    kind = ""  # pulses are whole numbers, positions have decimals
    frames = set()
    tool = frame = ""
    for number, line in enumerate(found.text.splitlines(), start=1):
        small = line.strip().lower()
        if small.startswith("//inst"):
            break
        if small.startswith(("///rectan", "///pulse")):
            kind = small[3:]
        elif small.startswith("///tool"):
            tool = small[3:]
        elif small.startswith("///user"):
            frame = small[3:]
        elif small.startswith("///postype"):
            frames.add(line.strip()[10:].strip())
            kind = "pulse" if "pulse" in small else "rectan"
        elif (match := _POSITION.fullmatch(line.rstrip())) is not None and match[1][0].upper() not in "BE":
            if kind.startswith("pulse") or (not kind and "." not in match[2]):
                found.joints += 1
                continue
            values = fields_of_list(match[2])
            if len(values) not in (6, 7, 8):
                raise InputError(
                    f"{found.name}, line {number}: expected x, y, z, Rx, Ry, Rz of {match[1]}, got {len(values)} "
                    f"numbers; {HELP}."
                )
            if tool or frame:
                found.tools.append(" ".join(f"{tool} {frame}".upper().split()))
            found.add(number, match, values[:6])
    if others := sorted(frame for frame in frames if frame.upper() not in ("ROBOT", "BASE", "PULSE")):
        found.notes.append(f"positions in the frame {', '.join(others)} of the job, not in the base of the robot")
