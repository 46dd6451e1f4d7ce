"""Names of errors in text.

>>> text_of("camera", "rotation", None, ""), text_of("target", "scale", None, "")
('camera rotation', 'target scale')
>>> text_of("robot", "joint offsets", "elbow", ""), text_of("camera", "principal point", "x", "")
('joint offsets: elbow', 'principal point x')
>>> text_of("robot", "accuracy", None, "left arm"), text_of("robot", "joint tilts", "elbow y", "left arm")
('left arm accuracy', 'left arm joint tilts: elbow y')
>>> text_of("session", "drift of the camera", None, "left"), text_of("session", "drift of the camera", None, "")
('left drift', 'drift of the camera')
>>> text_of("robot and camera", "rotation", None, "")
'rotation, robot and camera together'
"""

from __future__ import annotations

from collections.abc import Iterable

# Kinds that need their owner to be understood; others name it themselves.
_OF_OWNER = frozenset(
    {"rotation", "translation", "coupling", "(each pose)", "(shared)", "by view", "depth", "beyond its corners",
     "beyond its features",
     "scale", "accuracy", "(rotation and translation)"}
)  # fmt: skip
# Kinds that name their owner, behind another name.
_OF_NAME = dict.fromkeys(("drift of the camera", "drift of the target"), "drift")
_TOGETHER = frozenset({"robot and camera", "A and B"})
OWN = "own"


def text_of(owner: str, kind: str, index: int | str | None, name: str) -> str:
    """Return what an error, or one number of it, is called; see the module."""
    if kind == OWN:
        text = name
    elif owner in _TOGETHER:
        text = f"{kind}, {owner} together"
    elif name:
        text = f"{name} {_OF_NAME.get(kind, kind)}"
    else:
        text = f"{owner} {kind}" if kind in _OF_OWNER else f"{kind}"
    if index is None:
        return text
    return f"{text} {index}" if kind == "principal point" else f"{text}: {index}"


def text_of_source(errors: Iterable[str]) -> str:
    """Return what a source of a budget is called, of the errors that it is made of."""
    return " + ".join(errors)


# These errors have a plainer name in text.
_PLAIN = {"view": "camera errors by view"}


def plain_text(error: object) -> str:
    """Return what an error, or a source of a budget, is called where no other names of the program stand."""
    text = f"{error}"
    return _PLAIN.get(text, text)


def part_text(owner: str, kind: str, text: str) -> str:
    """Return what a part of the accuracy is called; ``text``: the error in words.

    >>> part_text("robot", "noise of the poses", ""), part_text("A", "noise of the poses", "")
    ('noise of the robot poses', 'noise of the A motions')
    >>> part_text("camera", "(shared)", "camera (shared)")
    'errors shared by all camera poses'
    """
    if kind == "noise of the poses":
        return kind if owner == "all" else f"noise of the {owner} {'motions' if owner in ('A', 'B') else 'poses'}"
    return f"errors shared by all {owner} poses" if kind == "(shared)" else plain_text(text)
