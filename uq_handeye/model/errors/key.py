"""`ErrorKey`, which names an error, or one number of it, everywhere in the program.

A key has the owner of the error, its kind and, of one of several numbers, which one: plain values, which files hold as
they are. What an error is called in text is the business of `key_text`; nothing is concluded from that text.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

from ...core.files.json_values import Json, JsonObject
from ...core.files.tree_values import is_map
from ...errors import InputError
from .key_text import text_of


class Owner(StrEnum):
    """Whose error it is."""

    ROBOT = "robot"
    CAMERA = "camera"
    TARGET = "target"
    TARGETS = "all targets"  # of a rig: they come from one printer
    SESSION = "session"  # independent in each session, such as a drift
    A = "A"  # of motions that came without poses
    B = "B"
    ROBOT_AND_CAMERA = "robot and camera"
    A_AND_B = "A and B"
    ALL = "all"  # sources of a budget that are of no one


class Kind(StrEnum):
    """The kinds of errors."""

    # drawn at each pose
    ROTATION = "rotation"
    TRANSLATION = "translation"
    COUPLING = "coupling"  # of the two
    BOTH = "(rotation and translation)"
    EACH_POSE = "(each pose)"  # all of one pose by itself
    DEPTH = "depth"
    BY_VIEW = "by view"
    PIXELS = "pixel noise"
    BEYOND_CORNERS = "beyond its corners"  # errors that the corners of one picture share
    BEYOND_FEATURES = "beyond its features"  # errors of pictures of a scene, per 1 of their own noise
    PICTURE_SHIFT = "shift of each picture"
    JOINT_NOISE = "joint noise"
    GIVEN = "given"
    # shared by poses
    FOCAL_LENGTH = "focal length"
    PRINCIPAL_POINT = "principal point"
    LENS = "lens distortion"
    OUTLINE = "target outline"
    VIEW = "view"
    INTRINSICS = "intrinsics"  # their covariance, as given
    FEATURES = "features of the scene"  # what camera poses by features share, their lens among it
    SCALE = "scale"
    CLOCK_OFFSET = "clock offset"
    ACCURACY = "accuracy"
    OFFSETS = "joint offsets"
    TILTS = "joint tilts"
    LENGTHS = "link lengths"
    TRANSMISSION = "transmission"
    SAG = "sag"
    CAMERA_DRIFT = "drift of the camera"
    TARGET_DRIFT = "drift of the target"
    WALK_IN_ROTATION = "random walk in rotation"
    WALK_IN_TRANSLATION = "random walk in translation"
    WALK_IN_SCALE = "random walk in scale"
    SHARED = "(shared)"  # columns of a given covariance
    OWN = "own"  # of the user, by name
    NEW = "new measurements"  # what they share by themselves
    # sources of a budget that are no error of a pose
    PRIOR_OF_X = "prior of X"
    PRIOR_OF_W = "prior of W"
    SIZES_OPEN = "sizes of the errors"
    MOTION = "motion in the session"
    POSES = "noise of the poses"
    POSES_AND_TOUCHES = "noise of the poses and touches"
    COVARIANCE = "all errors of the poses"
    OTHERS = "all other sources"
    # lines of a rig
    WIDTH = "half width of targets"


# Errors whose numbers are sources of a budget each.
DIVIDED = frozenset({Kind.PRINCIPAL_POINT})


@dataclass(frozen=True)
class ErrorKey:
    """An error, or one number of it; see the module."""

    owner: Owner
    kind: Kind
    index: int | str | None = None  # of one number: counted from 1, or such as the name of a joint; None: of them all
    name: str = ""  # of the arm, camera or target of a rig; of an error of the user's own

    @property
    def error(self) -> ErrorKey:
        """The error that a number belongs to."""
        return self if self.index is None else replace(self, index=None)

    @property
    def source(self) -> ErrorKey:
        """The source of a budget that a number belongs to: its error, or itself (`DIVIDED`)."""
        return self if self.kind in DIVIDED else self.error

    def number(self, index: int | str) -> ErrorKey:
        """Return the key of one number of the error."""
        return replace(self, index=index)

    def of(self, name: str) -> ErrorKey:
        """Return the key of the same error of an arm, a camera or a target of a rig."""
        return replace(self, name=name)

    def __str__(self) -> str:
        return text_of(self.owner, self.kind, self.index, self.name)

    def to_dict(self) -> JsonObject:
        """Return the plain values of a file."""
        more = {name: value for name in ("index", "name") if (value := getattr(self, name)) not in (None, "")}
        return {"owner": self.owner.value, "kind": self.kind.value, **more}

    @classmethod
    def from_dict(cls, data: Json) -> ErrorKey:
        """Read what `to_dict` wrote; raises `InputError` on anything else."""
        known = {"owner", "kind", "index", "name"}
        if not is_map(data) or not {"owner", "kind"} <= set(data) <= known:
            raise InputError(f"Expected the key of an error with owner and kind, got {data!r:.80}.")
        index, name = data.get("index"), data.get("name", "")
        if not (index is None or type(index) in (int, str)) or not isinstance(name, str):
            raise InputError(f"Expected the key of an error with a number or text as its index, got {data!r:.80}.")
        try:
            return cls(Owner(data["owner"]), Kind(data["kind"]), index, name)
        except ValueError:
            raise InputError(f"Expected the owner and kind of a known error, got {data!r:.80}.") from None


def by_text(keys: Iterable[ErrorKey]) -> dict[str, ErrorKey]:
    """Return keys by what they are called, to find the one that a user names."""
    return {str(key): key for key in keys}
