"""Pairs of poses as JSON lines of another program, in any form that a JSON file of poses may have.

{"robot": [[1, 0, 0, 0.4], ...], "camera": [[...], ...], "timestamp": 12.5}

Where the robot pose is taken from the arm itself when a line arrives, a line holds only the camera pose.
"""

from __future__ import annotations

import json
import queue
import threading
from collections.abc import Mapping
from typing import Any, TextIO

from ...core.limits import MAX_LINE_CHARACTERS
from ...errors import InputError
from ...formats.contents import FRAMES, finished
from ...formats.json_poses import read_json
from .sources import Pair, Side


class Lines:
    """Pairs from a text stream; ``how`` are arguments of `read_poses` on units and frames.

    ``robot``: asked when a line comes, in place of robot poses on the lines.
    """

    on_demand = False

    def __init__(
        self, stream: TextIO, how: Mapping[str, Any] | None = None, name: str = "standard input",
        robot: Side | None = None,
    ) -> None:  # fmt: skip
        self.name, self._how, self._count, self._robot = name, dict(how or {}), 0, robot
        self._lines: queue.Queue[str | None] = queue.Queue(1000)
        threading.Thread(target=self._read, args=(stream,), daemon=True).start()

    def _read(self, stream: TextIO) -> None:
        while line := stream.readline(MAX_LINE_CHARACTERS + 1):
            if line.strip():
                self._lines.put(line)
        self._lines.put(None)

    @property
    def pending(self) -> bool:
        """True if another line waits."""
        return not self._lines.empty() and self._lines.queue[0] is not None

    def take(self) -> Pair | None:
        """Return the pair of the next line; None at the end."""
        line = self._lines.get()
        if line is None:
            return None
        self._count += 1
        return pair_of(line, f"{self.name}, line {self._count}", self._how, self._robot)

    def close(self) -> None:
        """Let go of the robot."""
        if self._robot is not None:
            self._robot.close()


def pair_of(line: str, name: str, how: Mapping[str, Any] | None = None, robot: Side | None = None) -> Pair:
    """Return the pair on one line, read as a JSON file of poses is; raises `InputError` naming the line."""
    how = how or {}
    if len(line) > MAX_LINE_CHARACTERS:
        raise InputError(f"{name}: longer than {MAX_LINE_CHARACTERS} characters. Write one pair of poses on each line.")
    try:
        tree = json.loads(line)
        contents = read_json([tree] if isinstance(tree, dict) else tree, name)
    except RecursionError:
        raise InputError(f"{name}: lists or objects are nested too deep. The line is skipped.") from None
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f'{name}: expected JSON such as {{"robot": ..., "camera": ...}}: {error}.') from None
    poses, time = [], None
    for k, role in enumerate(FRAMES):
        if robot is not None and role == "robot":
            poses.append(robot.newest()[0])
            continue
        side = getattr(contents, role) or (contents.only if robot is not None else None)
        if side is None or len(side) != 1:
            what = "one robot and one camera pose, by the keys robot and camera"
            raise InputError(f"{name}: expected {what if robot is None else 'one camera pose, by the key camera'}.")
        unit, form = (how.get(key, (None, None))[k] for key in ("units", "rotation"))
        poses.append(finished(side, role, unit, form, how.get(f"{role}_frame", FRAMES[role][0]))[0])
        time = time if side.timestamps is None else float(side.timestamps[0])
    return Pair(poses[0], poses[1], time)
