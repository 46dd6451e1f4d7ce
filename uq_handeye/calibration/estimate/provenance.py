"""Origin of a result: the files, the numbers in them, the options and the versions; enough to repeat the run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from ...core.files.records import Record
from ...core.files.source import Source
from ...core.runtime.versions import versions
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.to_dict import sha256_of


@dataclass(frozen=True)
class Provenance(Record):
    """Input, options and versions of a calibration.

    ``data_sha256`` is the SHA-256 of the poses (or motions) as they were used, float64, little-endian, robot first: the
    same numbers give it whatever file they came from. ``options`` are the arguments of `calibrate`; ``command`` is the
    command line where there was one. ``request`` holds the arguments as they were given, by which the same can be asked
    of more poses (`Request.to_dict`); None in files of older versions.
    """

    _if_any: ClassVar[str] = "request"

    data_sha256: str
    options: dict[str, Any]
    versions: dict[str, str]
    sources: tuple[Source, ...] = field(default=())
    command: str | None = None
    request: dict[str, Any] | None = None


def provenance(data: PosePairs | Motions, options: dict[str, Any], request: dict[str, Any]) -> Provenance:
    """Record what `calibrate` was given."""
    sides = (data.robot, data.camera) if isinstance(data, PosePairs) else (data.A, data.B)
    poses = data.poses
    sources = () if poses is None else poses.sources
    return Provenance(sha256_of(*sides), options, dict(versions()), sources, request=request)
