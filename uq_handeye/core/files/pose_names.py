"""Names of poses in files of several arrays or entries: the side (robot or camera) and the frames of each name."""

from __future__ import annotations

import re
from collections.abc import Collection
from functools import lru_cache
from itertools import combinations

from ..limits import MAX_LISTED, MAX_NAME_CHARACTERS

_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_FRAMES = {
    "base": ("base", "world", "robotbase", "baselink", "fixed", "o"),  # O of Franka
    "gripper": ("gripper", "hand", "tool", "tcp", "ee", "eef", "flange", "endeffector", "effector", "wrist"),
    "camera": ("camera", "cam", "optical"),
    "target": (
        "target", "board", "tag", "marker", "pattern", "object", "checkerboard", "chessboard", "charuco", "aruco",
        "apriltag",
    ),
}  # fmt: skip
_FRAME_OF = {word: frame for frame, words in _FRAMES.items() for word in words}
# Words that say that something is a pose, and nothing of the frames.
_POSE = {"pose", "poses", "t", "h", "tf", "transform", "transforms", "transformation", "transformations", "mat", "mats"}
_POSE |= {"matrix", "matrices", "list", "all", "homogeneous"}
# Words between two frames: base_T_gripper, gripper2base, gripper_to_base, gripper_in_base.
_INVERTS = {"2", "to", "in"}
_ALONE = {"pose", "poses", "tf", "transform", "transforms", "transformation", "transformations"}
_SIDES = {
    ("base", "gripper"): ("robot", "base_T_gripper"),
    ("gripper", "base"): ("robot", "gripper_T_base"),
    ("camera", "target"): ("camera", "camera_T_target"),
    ("target", "camera"): ("camera", "target_T_camera"),
}


# Names of the robot's and the camera's poses that mean nothing alone: by their order, or by words.
_ORDERED = re.compile(r"(T|H|M|pose|poses|transform|transforms|trans)[_ ]?([12])", re.IGNORECASE)
_OF_ROBOT = ("hand", "arm", "robot", "gripper", "tcp", "ee", "flange", "tool")
_OF_CAMERA = (
    "eye", "target", "board", "marker", "tag", "camera", "cam", "pattern", "checkerboard", "aruco", "charuco",
)  # fmt: skip


def sides_of_names(names: Collection[str]) -> dict[str, str] | None:
    """Return side by name of two names that say it together only: T1 and T2 of camodocal, hand and eye; else None.

    >>> sides_of_names(["T2", "T1"]), sides_of_names(["A", "B"])
    ({'T1': 'robot', 'T2': 'camera'}, None)
    """
    if len(names) != 2:
        return None
    matches = [_ORDERED.fullmatch(name) for name in names]
    numbers = {name: (match[1].lower(), match[2]) for name, match in zip(names, matches, strict=True) if match}
    if len(numbers) == 2 and len({stem for stem, _ in numbers.values()}) == 1:
        first, second = sorted(numbers, key=lambda name: numbers[name][1])
        return {first: "robot", second: "camera"} if numbers[first] != numbers[second] else None
    small = {re.sub(r"[_ ]?(?:poses?|list|matrices)$", "", name.lower()): name for name in names}
    robots, cameras = ([small[word] for word in words if word in small] for words in (_OF_ROBOT, _OF_CAMERA))
    return {robots[0]: "robot", cameras[0]: "camera"} if len(robots) == len(cameras) == 1 else None


def poses_named(names: Collection[str]) -> dict[str, tuple[str, str]]:
    """Return side and frame of the names that say them, alone (`pose_name`) or as the only two that do together.

    >>> poses_named(["robot", "target", "image"])["target"]
    ('camera', 'camera_T_target')
    """
    found = {name: known for name in names if (known := pose_name(name)) is not None}
    if {role for role, _ in found.values()} == {"robot", "camera"} or len(names) > MAX_LISTED:
        return found
    pairs = [pair for two in combinations(names, 2) if (pair := sides_of_names(two)) is not None]
    if len(pairs) != 1 or any(pairs[0].get(name, role) != role for name, (role, _) in found.items()):
        return found
    usual = {"robot": _SIDES["base", "gripper"], "camera": _SIDES["camera", "target"]}
    return found | {name: usual[role] for name, role in pairs[0].items() if name not in found}


@lru_cache(maxsize=4096)
def pose_name(key: str) -> tuple[str, str] | None:
    """Return side and frame of poses by their name; None for a name that does not say them.

    ``A_T_B``, ``T_A_B`` and ``B2A`` (of OpenCV) are the pose of B in A.

    >>> pose_name("T_base_ee"), pose_name("target2cam"), pose_name("marker_pose"), pose_name("camera_matrix")
    (('robot', 'base_T_gripper'), ('camera', 'camera_T_target'), ('camera', 'camera_T_target'), None)
    """
    if not 0 < len(key) <= MAX_NAME_CHARACTERS:
        return None
    parts = _WORDS.findall(key.replace("tool0", "tool"))
    if "t" in parts:  # a translation; T is a pose
        return None
    words = [word.lower() for word in parts]
    if words in (["robot"], ["camera"]):
        return _SIDES["base", "gripper"] if words == ["robot"] else _SIDES["camera", "target"]
    frames: list[str] = []
    inverts, fillers = False, set()
    for word in words:
        if word in _FRAME_OF:
            if not frames or frames[-1] != _FRAME_OF[word]:  # end effector, camera optical
                frames.append(_FRAME_OF[word])
        elif word in _INVERTS and len(frames) == 1 and not inverts:
            inverts = True
        elif word in _POSE or word in ("robot", "end", "link", "frame"):
            fillers.add(word)
        else:
            return None
    if len(frames) == 2:
        return _SIDES.get((frames[1], frames[0]) if inverts else (frames[0], frames[1]))
    if inverts or not fillers & _ALONE or fillers & {"matrix", "matrices", "mat", "mats"}:
        return None
    if not frames and "robot" in fillers:
        return _SIDES["base", "gripper"]
    if frames in (["camera"], ["target"]) and "robot" not in fillers:
        return _SIDES["camera", "target"]
    return _SIDES["base", "gripper"] if frames == ["gripper"] else None
