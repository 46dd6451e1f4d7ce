"""Origin of a result: the files, the numbers in them, the options and the versions; enough to repeat the run."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from ..files.source import Source
from ..poses.motions import Motions
from ..poses.pose_pairs import PosePairs
from ..poses.to_dict import sha256_of
from ..runtime.versions import versions


@dataclass(frozen=True)
class Provenance:
    """Input, options and versions of a calibration.

    ``data_sha256`` is the SHA-256 of the poses (or motions) as they were used, float64, little-endian, robot first: the
    same numbers give it whatever file they came from. ``options`` are the arguments of `calibrate`; ``command`` is the
    command line where there was one.
    """

    data_sha256: str
    options: dict[str, Any]
    versions: dict[str, str]
    sources: tuple[Source, ...] = field(default=())
    command: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and text."""
        sources = [asdict(source) | {"notes": list(source.notes)} for source in self.sources]
        return asdict(self) | {"sources": sources}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Provenance:
        """The inverse of `to_dict`."""
        sources = tuple(Source(**(source | {"notes": tuple(source["notes"])})) for source in data["sources"])
        return cls(**(data | {"sources": sources}))


def provenance(data: PosePairs | Motions, options: dict[str, Any]) -> Provenance:
    """Record what `calibrate` was given."""
    sides = (data.robot, data.camera) if isinstance(data, PosePairs) else (data.A, data.B)
    poses = data if isinstance(data, PosePairs) else data.poses
    return Provenance(sha256_of(*sides), options, dict(versions()), () if poses is None else poses.sources)
