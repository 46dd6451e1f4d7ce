"""The chain of joints between two links of a URDF (Unified Robot Description Format), ROS's XML of robots.

The reader uses ``<link>``, and of ``<joint>`` its type, ``<parent>``, ``<child>``, ``<origin xyz rpy>``, ``<axis>``,
``<limit>`` and ``<mimic>``; metres and radians, ``rpy`` about the fixed axes x, y, z in this order. A joint without
``<axis>`` has (1, 0, 0), as the format says. Limits that are missing or equal are none.

Nothing in a file can run or grow (`xml_tree`).

`urdf_with_origins` writes other origins of some joints: the rest of the text stays as it is.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from ....core.files.lines import decoded, is_number
from ....core.files.one_line import one_line, short
from ....core.files.open import StrPath, as_path, opened, shown
from ....core.files.trees import MAX_DEPTH
from ....core.geometry.rotations import Rotation
from ....core.geometry.se3 import Array
from ....core.limits import MAX_DESCRIPTION_BYTES
from ....errors import InputError
from ..joint import MAX_ORIGIN_M, PRISMATIC, REVOLUTE, ChainParts, Joint
from .xml_tree import Element, xml_tree

MOVING = {"revolute": REVOLUTE, "continuous": REVOLUTE, "prismatic": PRISMATIC}
# Usual names of the frame at the end of an arm, best first.
FLANGES = ("tool0", "flange")

# Elements of a joint that are read.
_PARTS = ("parent", "child", "origin", "axis", "limit", "mimic")


class _Joint(NamedTuple):
    """A joint as the file has it."""

    name: str
    type: str
    line: int
    parts: dict[str, dict[str, str]]

    @property
    def parent(self) -> str:
        return self.parts["parent"]["link"]

    @property
    def child(self) -> str:
        return self.parts["child"]["link"]


@dataclass
class Tree:
    """The links of a file, and its joints by the names of their children."""

    where: str
    name: str
    links: dict[str, None]
    joints: list[_Joint]

    def __post_init__(self) -> None:
        self.above: dict[str, list[_Joint]] = {}
        self.below: dict[str, list[_Joint]] = {}
        for joint in self.joints:
            self.above.setdefault(joint.child, []).append(joint)
            self.below.setdefault(joint.parent, []).append(joint)


def read_urdf(path_or_text: StrPath, base: str | None = None, tip: str | None = None) -> ChainParts:
    """The chain between two links; raises `InputError` for what cannot be one, in words."""
    return chain_of(read_tree(path_or_text), base, tip, {})


def read_tree(path_or_text: StrPath) -> Tree:
    """All links and joints."""
    return _parse(*description_text(path_or_text))


def chain_of(tree: Tree, base: str | None, tip: str | None, origins: Mapping[str, Array]) -> ChainParts:
    """The chain between two links, with other origins (4, 4) of some joints, by name."""
    where = tree.where
    base = _root(tree) if base is None else _link(tree, base, "base")
    tip = _leaf(tree, base) if tip is None else _link(tree, tip, "tip")
    T, down = _path(tree, base, tip)
    joints: list[Joint] = []
    for part in down:
        T = T @ (origins[part.name] if part.name in origins else origin_of(part, where))
        if part.type == "fixed":
            continue
        _require_moving(part, where)
        joints.append(_moving(part, T, where))
        T = np.eye(4)
    if not joints:
        raise InputError(f"{where}: no joint moves between {short(base)} and {short(tip)}; check base and tip.")
    return ChainParts(tree.name or "robot", base, tip, tuple(joints), T)


def description_text(path_or_text: StrPath, what: str = "a URDF") -> tuple[str, str]:
    """Return the text of a description of a robot, which may be given itself, and what to call it in messages."""
    if isinstance(path_or_text, str) and path_or_text.lstrip("\ufeff \t\r\n").startswith("<"):
        if len(path_or_text) > MAX_DESCRIPTION_BYTES:
            raise InputError(f"Expected {what} of at most {MAX_DESCRIPTION_BYTES / 1e6:g} MB, got more.")
        return path_or_text.lstrip("\ufeff \t\r\n"), f"the {what.partition(' ')[2]}"
    path = as_path(path_or_text)
    if os.fspath(path).endswith(".xacro"):
        raise InputError(f"{shown(path)} is a xacro file; run xacro first: xacro {path.name} > robot.urdf.")
    with opened(path, MAX_DESCRIPTION_BYTES) as file:
        data = file.read()
    name = shown(path)
    return decoded(data.removeprefix(b"\xef\xbb\xbf"), f"{name}: expected {what}").lstrip(), name


def _check(tag: str, is_root: bool, at: str) -> None:
    if tag.startswith("xacro:"):
        raise InputError(f"{at}: <{one_line(tag)}> is xacro, not URDF; run xacro first: xacro NAME > robot.urdf.")
    if is_root and tag != "robot":
        hint = "; give an MJCF model by --robot-model FILE.xml" if tag == "mujoco" else ""
        raise InputError(f"{at}: expected a URDF, which starts with <robot>, got <{one_line(tag)}>{hint}.")


def _parse(text: str, where: str) -> Tree:
    root = xml_tree(text, where, MAX_DEPTH, _check)
    links: dict[str, None] = {}
    joints: dict[str, _Joint] = {}
    for element in root.children:
        if element.tag not in ("link", "joint"):
            continue
        at, name = f"{where}, line {element.line}", element.attributes.get("name", "")
        if not name:
            raise InputError(f"{at}: expected a name of this <{element.tag}>.")
        if name in (links if element.tag == "link" else joints):
            raise InputError(f"{at}: there are two {element.tag}s of the name {short(name)}.")
        if element.tag == "link":
            links[name] = None
        else:
            joints[name] = _joint_of(element, name, where)
    for joint in joints.values():
        for link in (joint.parent, joint.child):
            if link not in links:
                raise InputError(
                    f"{where}, line {joint.line}: joint {short(joint.name)} is at the link {short(link)}, which is not "
                    f"in the file{nearest(link, links)}."
                )
    return Tree(where, one_line(root.attributes.get("name", "")), links, list(joints.values()))


def _joint_of(element: Element, name: str, where: str) -> _Joint:
    """Return a joint with its parts, each once, and the links that it joins."""
    parts: dict[str, dict[str, str]] = {}
    for part in element.children:
        if part.tag not in _PARTS:
            continue
        at = f"{where}, line {part.line}"
        if part.tag in parts:
            raise InputError(f"{at}: joint {short(name)} has two <{part.tag}>.")
        if part.tag in ("parent", "child") and not part.attributes.get("link"):
            raise InputError(f"{at}: expected a link of <{part.tag}> of joint {short(name)}.")
        parts[part.tag] = part.attributes
    for tag in ("parent", "child"):
        if tag not in parts:
            raise InputError(f"{where}, line {element.line}: joint {short(name)} has no <{tag}>.")
    return _Joint(name, element.attributes.get("type", ""), element.line, parts)


def nearest(name: str, names: Iterable[str]) -> str:
    """The most similar of the names, as an end of a sentence."""
    known = list(names)[:2000]
    close = difflib.get_close_matches(name[:200], known, n=3, cutoff=0.5) or known[:6]
    return f"; nearest: {', '.join(map(short, close))}" if close else ""


def _link(tree: Tree, name: str, role: str) -> str:
    if not isinstance(name, str) or name not in tree.links:
        raise InputError(
            f"{tree.where}: there is no link {short(str(name))} for the {role}{nearest(str(name), tree.links)}."
        )
    return name


def _root(tree: Tree) -> str:
    roots = [link for link in tree.links if link not in tree.above]
    if len(roots) == 1:
        return roots[0]
    if not tree.links:
        raise InputError(f"{tree.where}: there are no links; is it a URDF?")
    if not roots:
        raise InputError(f"{tree.where}: the joints form a loop, no link is the root; give the base.")
    raise InputError(f"{tree.where}: expected one root link, got {some(roots)}; give the base.")


def _leaf(tree: Tree, base: str) -> str:
    """The one leaf below the base behind a moving joint."""
    leaves, seen, waiting = [], {base}, [(base, False)]
    while waiting:
        link, moves = waiting.pop()
        below = tree.below.get(link, [])
        if moves and not below:
            leaves.append(link)
        for joint in below:
            if joint.child not in seen:
                seen.add(joint.child)
                waiting.append((joint.child, moves or joint.type in MOVING))
    if len(leaves) == 1:
        return leaves[0]
    if not leaves:
        for link in tree.above:  # two joints that lead to the same link are no chain
            _ancestors(tree, link)
        raise InputError(f"{tree.where}: no link moves with respect to {short(base)}; check the base.")
    usual = [name for name in FLANGES if name in seen]
    leaves = sorted(leaves, key=lambda name: name not in FLANGES)
    hint = f"; usual is {usual[0]}" if usual else ""
    raise InputError(f"{tree.where}: the arm has several ends, {some(leaves)}; give the tip{hint}.")


def some(names: list[str]) -> str:
    """Return the first of many names for a message."""
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    return ", ".join(map(short, names[:8])) + more


def _path(tree: Tree, base: str, tip: str) -> tuple[Array, list[_Joint]]:
    """The transform up from the base, through fixed joints, and the joints down to the tip."""
    up, down = _ancestors(tree, base), _ancestors(tree, tip)
    above_base = {base: 0, **{joint.parent: k + 1 for k, joint in enumerate(up)}}
    links = [tip, *(joint.parent for joint in down)]
    meeting = next((k for k, link in enumerate(links) if link in above_base), None)
    if meeting is None:
        raise InputError(f"{tree.where}: {short(base)} and {short(tip)} are not connected; check base and tip.")
    T: Array = np.eye(4)
    for joint in up[: above_base[links[meeting]]]:
        if joint.type != "fixed":
            raise InputError(
                f"{tree.where}: the tip {short(tip)} is not below the base {short(base)}: joint {short(joint.name)}, "
                "which moves, leads up from the base. Exchange base and tip, or give another base."
            )
        origin = origin_of(joint, tree.where)
        T[:3, :3], T[:3, 3] = T[:3, :3] @ origin[:3, :3].T, T[:3, 3] - T[:3, :3] @ origin[:3, :3].T @ origin[:3, 3]
    return T, down[:meeting][::-1]


def _ancestors(tree: Tree, link: str) -> list[_Joint]:
    """The joints from a link up to the root."""
    found, seen = [], {link}
    while link in tree.above:
        joints = tree.above[link]
        if len(joints) > 1:
            raise InputError(
                f"{tree.where}: the joints {some([joint.name for joint in joints])} lead to the same link "
                f"{short(link)}, a loop; expected a serial chain."
            )
        link = joints[0].parent
        found.append(joints[0])
        if link in seen:
            raise InputError(f"{tree.where}: joint {short(joints[0].name)} closes a loop; expected a serial chain.")
        seen.add(link)
    return found


def _require_moving(part: _Joint, where: str) -> None:
    at = f"{where}, line {part.line}: joint {short(part.name)}"
    if part.type not in MOVING:
        raise InputError(
            f"{at} is of the type {short(part.type)}; expected revolute, continuous, prismatic or fixed joints between "
            "base and tip."
        )
    if "mimic" in part.parts:
        other = short(part.parts["mimic"].get("joint", ""))
        raise InputError(f"{at} mimics {other}; expected joints that move by themselves between base and tip.")


def _moving(part: _Joint, origin: Array, where: str) -> Joint:
    axis = _numbers(part, "axis", "xyz", (1.0, 0.0, 0.0), where)
    if not np.abs(axis).max() > 1e-9:
        raise InputError(f"{where}, line {part.line}: the axis of joint {short(part.name)} is zero.")
    lower, upper = -np.inf, np.inf
    limit = part.parts.get("limit", {})
    if part.type != "continuous":
        if "lower" in limit:
            lower = _number(limit["lower"], part, "limit", "lower", where)
        if "upper" in limit:
            upper = _number(limit["upper"], part, "limit", "upper", where)
        if lower > upper:
            at = f"{where}, line {part.line}"
            raise InputError(f"{at}: the limits of joint {short(part.name)} are reversed, {lower:g} to {upper:g}.")
        if lower == upper:
            lower, upper = -np.inf, np.inf
    try:
        return Joint(part.name, MOVING[part.type], origin, axis, lower, upper)
    except InputError as error:
        text = str(error)
        raise InputError(f"{where}, line {part.line}: {text[0].lower()}{text[1:]}") from error


def origin_of(part: _Joint, where: str) -> Array:
    """The ``<origin>`` (4, 4) of a joint."""
    xyz = _numbers(part, "origin", "xyz", (0.0, 0.0, 0.0), where)
    if (longest := float(np.abs(xyz).max())) > MAX_ORIGIN_M:
        raise InputError(
            f"{where}, line {part.line}: the origin of joint {short(part.name)} is {longest:g} m away; is the file in "
            "millimetres? URDF is in metres."
        )
    T: Array = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", _numbers(part, "origin", "rpy", (0.0, 0.0, 0.0), where)).as_matrix()
    T[:3, 3] = xyz
    return T


def _numbers(part: _Joint, tag: str, name: str, default: tuple[float, ...], where: str) -> Array:
    text = part.parts.get(tag, {}).get(name)
    if text is None:
        return np.array(default)
    words = text.split()
    if len(words) != 3 and "${" not in text:
        raise InputError(
            f"{where}, line {part.line}: expected 3 numbers as {name} of <{tag}> of joint {short(part.name)}, got "
            f"{short(text)}."
        )
    return np.array([_number(word, part, tag, name, where) for word in words])


def _number(word: str, part: _Joint, tag: str, name: str, where: str) -> float:
    at = f"{where}, line {part.line}"
    if "$" in word:
        raise InputError(f"{at}: {short(word)} is xacro, not URDF; run xacro first: xacro NAME > robot.urdf.")
    value = float(word) if is_number(word.encode()) else np.nan
    if not np.isfinite(value):
        raise InputError(
            f"{at}: expected finite numbers as {name} of <{tag}> of joint {short(part.name)}, got {short(word)}."
        )
    return value


class Placed(NamedTuple):
    """An ``<origin>``."""

    xyz: Array  # (3,) m
    rpy: Array  # (3,) rad, about the fixed axes x, y, z

    @property
    def attributes(self) -> str:
        xyz, rpy = (" ".join(f"{value:.17g}" for value in values) for values in self)
        return f'xyz="{xyz}" rpy="{rpy}"'


def with_origins(path_or_text: StrPath, origins: Mapping[str, Placed], comment: str = "") -> str:
    """Return the text of a URDF with these origins of joints, by name, and a comment in front of ``<robot>``.

    Raises `InputError` as `urdf.read_tree`, for the same files.
    """
    read_tree(path_or_text)  # refuses what is no URDF, document types and entities
    data = description_text(path_or_text)[0].encode()
    parser = expat.ParserCreate("UTF-8")
    stack: list[tuple[str, str]] = []
    edits: list[tuple[int, int, str]] = []  # first byte, end, what takes its place
    waiting: dict[str, int] = {}  # joints without an origin so far: the end of their start tag

    def start(tag: str, attributes: dict[str, str]) -> None:
        here = parser.CurrentByteIndex
        stack.append((tag, attributes.get("name", "")))
        if not stack[:-1] and comment:
            edits.append((here, here, f"<!-- {escape(comment, quote=False).replace('--', '- -')} -->\n"))
        depth, joint = len(stack), stack[1][1] if len(stack) > 1 and stack[1][0] == "joint" else ""
        if joint not in origins:
            return
        if depth == 2:
            waiting[joint] = _end_of_tag(data, here)
        elif depth == 3 and tag == "origin":
            end = _end_of_tag(data, here)
            closing = "/>" if data[end - 2 : end] == b"/>" else ">"
            edits.append((here, end, f"<origin {origins[joint].attributes}{closing}"))
            del waiting[joint]

    def end(tag: str) -> None:
        if len(stack) == 2 and tag == "joint" and (at := waiting.pop(stack[1][1], None)) is not None:
            edits.append((at, at, f"\n    <origin {origins[stack[1][1]].attributes}/>"))
        stack.pop()

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(data, True)
    for first, last, text in sorted(edits, reverse=True):
        data = data[:first] + text.encode() + data[last:]
    return data.decode()


def _end_of_tag(data: bytes, at: int) -> int:
    """Return where the tag that starts at a byte ends: a ``>`` outside of quotes."""
    quote = b""
    for k in range(at, len(data)):
        byte = data[k : k + 1]
        if quote:
            quote = b"" if byte == quote else quote
        elif byte in (b'"', b"'"):
            quote = byte
        elif byte == b">":
            return k + 1
    return len(data)
