"""Joint values in a recording, by topic: arm and gripper may publish messages of their own on one topic."""

from __future__ import annotations

from dataclasses import dataclass, field

from ...core.files.csv_text import csv_text
from ...core.limits import MAX_LISTED
from .track import Samples


class JointTrack(Samples):
    """Values of joints by their names, as they arrive."""

    def __init__(self, names: list[str]) -> None:
        super().__init__(f"the joints {', '.join(names[:3])}", len(names))
        self.names = names


@dataclass
class JointTopic:
    """Joint values of one topic: arm and gripper may publish messages of their own on it."""

    sets: dict[frozenset[str], JointTrack] = field(default_factory=dict)
    skipped: int = 0

    def add(self, time: float, names: list[str], values: list[float]) -> None:
        """Append one message to those of the same joints."""
        found = dict(zip(names, values, strict=True))
        key = frozenset(found)
        if key not in self.sets and len(self.sets) >= MAX_LISTED:
            self.skipped += 1
            return
        track = self.sets.setdefault(key, JointTrack(list(found)))
        track.add(time, (found[name] for name in track.names))

    @property
    def tracks(self) -> list[JointTrack]:
        """Tracks by their joints, those of most joints first."""
        return sorted(self.sets.values(), key=lambda one: (-len(one.names), -len(one)))


def joints_csv(track: JointTrack) -> str:
    """Return joint values as a table with the header ``timestamp`` and the names of the joints."""
    return csv_text([["timestamp", *track.names], *track.values.tolist()])
