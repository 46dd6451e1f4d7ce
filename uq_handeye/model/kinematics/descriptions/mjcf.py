r"""The chain of joints between two bodies of an MJCF model, MuJoCo's XML of robots.

The reader uses, as MuJoCo 4.0 does:

- ``<compiler>``: ``angle`` (degree where it is not said), ``eulerseq`` (``xyz``; lower case rotates about moving axes,
  upper case about fixed ones) and ``autolimits`` (true).
- ``<default>`` classes of ``<joint>`` and ``<site>``, nested, chosen by ``class`` or the nearest ``childclass``.
- ``<body>`` and ``<frame>``: ``pos`` and one of ``quat`` (w x y z), ``axisangle``, ``euler``, ``xyaxes``, ``zaxis``.
- ``<joint>``: ``type`` (hinge), ``axis`` (z), ``pos``, ``ref``, ``range``, ``limited``; several in one body follow each
  other. ``<site>`` can be the tip, as a body can.
- ``<option gravity>``: its opposite is the direction ``up`` of the base.

A joint in the frame of its body, with anchor p and reference value r, moves the body by

    Trans(p) M(q - r) Trans(-p)  hinge,      Trans((q - r) a)  slide

so ``M(-r) Trans(-p)`` is part of the next origin. Ball and free joints between base and tip, joints that an
``<equality>`` couples, ``<include>``, ``<attach>`` and ``<replicate>`` are refused; nothing else of a file matters.
Document types and entities are refused (`xml_tree`).
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from ....core.files.lines import is_number
from ....core.files.one_line import one_line, short
from ....core.files.open import StrPath
from ....core.files.trees import MAX_DEPTH
from ....core.geometry.rotations import Rotation
from ....core.geometry.se3 import Array, inverse, pose
from ....errors import InputError
from ..joint import MAX_ORIGIN_M, PRISMATIC, REVOLUTE, ChainParts, Joint
from .urdf import description_text, nearest, some
from .xml_tree import Element, xml_tree

WORLD = "world"
KINDS = {"hinge": REVOLUTE, "slide": PRISMATIC}
SUFFIXES = (".xml", ".mjcf")
ORIENTATIONS = {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}
# Elements that bring in bodies which the file does not name, and what to do.
ONE_FILE = (
    'Write the model as MuJoCo compiles it: python -c "import mujoco; '
    "mujoco.mj_saveLastXML('one.xml', mujoco.MjModel.from_xml_path('model.xml'))\"."
)
NOT_READ = ("include", "attach", "replicate")
# Usual names of the frame at the end of an arm.
FLANGES = ("attachment_site", "flange", "tool0")


class _Frame(NamedTuple):
    """A body or site: its place in the body above, and joints in their order."""

    name: str
    above: str | None
    origin: Array
    joints: list[_Joint]
    is_site: bool = False


class _Joint(NamedTuple):
    """A joint in the frame of its body."""

    name: str
    kind: str
    line: int
    anchor: Array
    axis: Array
    ref: float
    lower: float
    upper: float

    def motion(self, value: float) -> Array:
        """Motion (4, 4) at a value, without the anchor."""
        axis = self.axis / np.linalg.norm(self.axis)
        if self.kind == REVOLUTE:
            return pose(Rotation.from_rotvec(value * axis).as_matrix(), np.zeros(3))
        return pose(np.eye(3), value * axis)


def is_mjcf(name: str) -> bool:
    """Return whether the name of a robot model is that of an MJCF file."""
    return os.fspath(name).lower().endswith(SUFFIXES)


def read_mjcf(path_or_text: StrPath, base: str | None = None, tip: str | None = None) -> ChainParts:
    """Return the chain between two bodies; raises `InputError` for what cannot be one."""
    return _Model(*description_text(path_or_text, "an MJCF model")).chain(base, tip)


def _check(tag: str, is_root: bool, at: str) -> None:
    if is_root and tag != "mujoco":
        hint = "; give a URDF by --urdf" if tag == "robot" else ""
        raise InputError(f"{at}: expected an MJCF model, which starts with <mujoco>, got <{one_line(tag)}>{hint}.")


class _Model:
    """The frames of a file by name, in the order of the file."""

    def __init__(self, text: str, where: str) -> None:
        self.where = where
        root = xml_tree(text, where, 10 * MAX_DEPTH, _check)
        self.name = one_line(root.attributes.get("model", "")) or "robot"
        of_compiler: dict[str, str] = {}
        for element in self._all(root, "compiler"):
            of_compiler |= element.attributes
        angle = of_compiler.get("angle", "degree")
        if angle not in ("degree", "radian"):
            raise InputError(f"{where}: expected the angle of <compiler> to be degree or radian, got {short(angle)}.")
        if of_compiler.get("coordinate", "local") != "local":
            raise InputError(f"{where}: global coordinates are not read. Save the model with a MuJoCo of today.")
        self.radians = np.pi / 180.0 if angle == "degree" else 1.0
        self.sequence = of_compiler.get("eulerseq", "xyz")
        if len(self.sequence) != 3 or set(self.sequence.lower()) - set("xyz"):
            raise InputError(f"{where}: expected three of x, y, z as eulerseq, got {short(self.sequence)}.")
        self.autolimits = of_compiler.get("autolimits", "true") == "true"
        self.gravity = np.array([0.0, 0.0, -9.81])
        for element in self._all(root, "option"):
            self.gravity = self._numbers(element, "gravity", self.gravity)
        self.defaults: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for element in self._all(root, "default"):
            self._read_default(element, {}, top=True)
        self.frames: dict[str, _Frame] = {WORLD: _Frame(WORLD, None, np.eye(4), [])}
        self.joint_names: set[str] = set()
        for element in self._all(root, "worldbody"):
            self._read_children(element, WORLD, np.eye(4), "main")
        self.coupled: dict[str, tuple[str, int]] = {}
        for element in self._all(root, "equality"):
            for one in element.children:
                names = [one.attributes.get(key, "") for key in ("joint1", "joint2")]
                if one.tag == "joint" and one.attributes.get("active", "true") == "true":
                    self.coupled[names[0]] = names[1], one.line

    def _all(self, root: Element, tag: str) -> Iterator[Element]:
        for element in root.children:
            self._require_read(element)
            if element.tag == tag:
                yield element

    def _at(self, element: Element) -> str:
        named = f" {short(element.attributes['name'])}" if "name" in element.attributes else ""
        return f"{self.where}, line {element.line}: {element.tag}{named}"

    def _require_read(self, element: Element) -> None:
        if element.tag in NOT_READ:
            raise InputError(f"{self.where}, line {element.line}: <{element.tag}> is not read. {ONE_FILE}")

    # ------------------------------------------------------------------------------------------- classes

    def _read_default(self, element: Element, above: Mapping[str, dict[str, str]], top: bool = False) -> None:
        name = "main" if top else element.attributes.get("class", "")
        if not name:
            raise InputError(f"{self.where}, line {element.line}: expected a class of this <default>.")
        if top and "class" in element.attributes:
            self.defaults[element.attributes["class"]] = self.defaults["main"]
        own = self.defaults.setdefault(name, {})
        for tag, attributes in above.items():
            own[tag] = attributes | own.get(tag, {})
        for child in element.children:
            self._require_read(child)
            if child.tag in ("joint", "site"):
                own[child.tag] = _replaced(own.get(child.tag, {}), child.attributes)
        for child in element.children:
            if child.tag == "default":
                self._read_default(child, own)

    def _with_defaults(self, element: Element, childclass: str) -> Element:
        name = element.attributes.get("class", childclass)
        self._require_class(element, name)
        given = _replaced(self.defaults[name].get(element.tag, {}), element.attributes)
        return Element(element.tag, given, element.line, [])

    def _require_class(self, element: Element, name: str) -> None:
        if name not in self.defaults:
            raise InputError(f"{self._at(element)} is of the class {short(name)}, which <default> does not have.")

    # ------------------------------------------------------------------------------------------- bodies

    def _read_children(self, parent: Element, body: str, T: Array, childclass: str) -> None:
        """Read what is in a body or in a frame at T in it."""
        for element in parent.children:
            self._require_read(element)
            if element.tag in ("body", "frame"):
                below = element.attributes.get("childclass", childclass)
                self._require_class(element, below)
                origin = T @ self._placed(element)
                if element.tag == "frame":
                    self._read_children(element, body, origin, below)
                else:
                    name = self._add(element, body, origin)
                    self._read_children(element, name, np.eye(4), below)
            elif element.tag == "site":
                if "name" in element.attributes:
                    self._add(element, body, T @ self._placed(self._with_defaults(element, childclass)))
            elif element.tag in ("joint", "freejoint"):
                self._add_joint(element, body, T, childclass)

    def _add(self, element: Element, above: str, origin: Array) -> str:
        name = element.attributes.get("name") or f"body_{len(self.frames)}"
        if name in self.frames:
            if element.tag == "site":  # sites and bodies have names apart: the body keeps it
                return name
            if not self.frames[name].is_site:
                raise InputError(f"{self._at(element)}: there are two bodies of this name.")
        if (longest := float(np.abs(origin[:3, 3]).max())) > MAX_ORIGIN_M:
            raise InputError(f"{self._at(element)} is {longest:g} m away; is the model in millimetres?")
        self.frames[name] = _Frame(name, above, origin, [], is_site=element.tag == "site")
        return name

    def _add_joint(self, element: Element, body: str, T: Array, childclass: str) -> None:
        frame = self.frames[body]
        number = f"_{len(frame.joints) + 1}" if frame.joints else ""
        name = element.attributes.get("name") or f"{body}_joint{number}"
        if name in self.joint_names:
            raise InputError(f"{self._at(element)}: there are two joints of this name.")
        self.joint_names.add(name)
        if element.tag == "freejoint":
            frame.joints.append(_Joint(name, "free", element.line, np.zeros(3), np.zeros(3), 0.0, -np.inf, np.inf))
            return
        given = self._with_defaults(element, childclass)
        type = given.attributes.get("type", "hinge")
        kind = KINDS.get(type, type)
        unit = self.radians if kind == REVOLUTE else 1.0
        ref = unit * float(self._numbers(given, "ref", np.zeros(1))[0])
        lower, upper = unit * self._numbers(given, "range", np.zeros(2))
        limited = given.attributes.get("limited", "auto")
        if limited == "auto" and "range" in given.attributes and not self.autolimits:
            raise InputError(f"{self._at(element)} has a range and, with autolimits false, no `limited`.")
        if limited == "false" or not lower < upper:
            lower, upper = -np.inf, np.inf
        anchor = T[:3, :3] @ self._numbers(given, "pos", np.zeros(3)) + T[:3, 3]
        axis = T[:3, :3] @ self._numbers(given, "axis", np.array([0.0, 0.0, 1.0]))
        if not np.abs(axis).max() > 1e-9:
            raise InputError(f"{self._at(element)}: the axis is zero.")
        frame.joints.append(_Joint(name, kind, element.line, anchor, axis, ref, float(lower), float(upper)))

    def _placed(self, element: Element) -> Array:
        """(4, 4) of an element's pos and orientation."""
        given = [name for name in ORIENTATIONS if name in element.attributes]
        if len(given) > 1:
            raise InputError(f"{self._at(element)} has {' and '.join(given)}; expected one orientation.")
        R = np.eye(3)
        if given:
            R = self._rotation(given[0], self._numbers(element, given[0], np.zeros(ORIENTATIONS[given[0]])), element)
        return pose(R, self._numbers(element, "pos", np.zeros(3)))

    def _rotation(self, name: str, values: Array, element: Element) -> Array:
        def unit(v: Array) -> Array:
            length = float(np.linalg.norm(v))
            if not length > 1e-9:
                raise InputError(f"{self._at(element)}: {name} is no orientation, {values.tolist()}.")
            return np.asarray(v / length)

        if name == "quat":
            return np.asarray(Rotation.from_quat(np.roll(unit(values), -1)).as_matrix())
        if name == "axisangle":
            return np.asarray(Rotation.from_rotvec(self.radians * values[3] * unit(values[:3])).as_matrix())
        if name == "euler":
            R = np.eye(3)
            for axis, angle in zip(self.sequence, self.radians * values, strict=True):
                about = Rotation.from_rotvec(angle * np.eye(3)["xyz".index(axis.lower())]).as_matrix()
                R = R @ about if axis.islower() else about @ R
            return R
        if name == "xyaxes":
            x = unit(values[:3])
            y = unit(values[3:] - (values[3:] @ x) * x)
            return np.stack([x, y, np.cross(x, y)], axis=1)
        z = unit(values)
        about = np.cross([0.0, 0.0, 1.0], z)
        sine = float(np.linalg.norm(about))
        about = about / sine if sine > 1e-12 else np.array([1.0, 0.0, 0.0])
        return np.asarray(Rotation.from_rotvec(np.arctan2(sine, z[2]) * about).as_matrix())

    def _numbers(self, element: Element, name: str, default: Array) -> Array:
        text = element.attributes.get(name)
        if text is None:
            return default
        words = text.split()
        values = np.array([float(word) if is_number(word.encode()) else np.nan for word in words])
        if len(values) != len(default) or not np.isfinite(values).all():
            raise InputError(
                f"{self._at(element)}: expected {len(default)} finite numbers as {name}, got {short(text)}."
            )
        return values

    # ------------------------------------------------------------------------------------------- the chain

    def chain(self, base: str | None, tip: str | None) -> ChainParts:
        """Return the chain from a body (the world) to a body or site (the only end behind a moving joint)."""
        base = WORLD if base is None else self._known(base, "base")
        tip = self._end(base) if tip is None else self._known(tip, "tip")
        path = self._up(tip)
        if base not in path:
            raise InputError(
                f"{self.where}: the tip {short(tip)} is not below the base {short(base)}. Give other bodies as base "
                "and tip."
            )
        joints: list[Joint] = []
        T: Array = np.eye(4)
        for name in path[: path.index(base)][::-1]:
            frame = self.frames[name]
            T = T @ frame.origin
            for one in frame.joints:
                self._require_chain(one)
                T = T @ pose(np.eye(3), one.anchor)
                joints.append(self._moving(one, T))
                T = one.motion(-one.ref) @ pose(np.eye(3), -one.anchor)
        if not joints:
            raise InputError(
                f"{self.where}: no joint moves between {short(base)} and {short(tip)}; check base and tip."
            )
        return ChainParts(self.name, base, tip, tuple(joints), T, self._against_gravity(base))

    def _known(self, name: str, role: str) -> str:
        if name not in self.frames:
            raise InputError(
                f"{self.where}: there is no body or site {short(str(name))} for the {role}"
                f"{nearest(str(name), self.frames)}."
            )
        return name

    def _up(self, name: str) -> list[str]:
        """Return the frames from one up to the world."""
        found = [name]
        while (above := self.frames[found[-1]].above) is not None:
            found.append(above)
        return found

    def _end(self, base: str) -> str:
        bodies = [name for name, frame in self.frames.items() if not frame.is_site]
        parents = {self.frames[name].above for name in bodies}
        ends = []
        for name in bodies:
            path = self._up(name)
            if name not in parents and base in path and any(self.frames[k].joints for k in path[: path.index(base)]):
                ends.append(name)
        if len(ends) == 1:
            return ends[0]
        if not ends:
            raise InputError(f"{self.where}: no body moves with respect to {short(base)}; check the base.")
        usual = [name for name in FLANGES if name in self.frames]
        hint = f"; usual is {usual[0]}" if usual else ""
        raise InputError(f"{self.where}: the model has several ends, {some(ends)}; give the tip{hint}.")

    def _require_chain(self, one: _Joint) -> None:
        at = f"{self.where}, line {one.line}: joint {short(one.name)}"
        if one.kind not in (REVOLUTE, PRISMATIC):
            hint = "; give the base that floats as the base" if one.kind == "free" else ""
            raise InputError(
                f"{at} is of the type {short(one.kind)}; expected hinge and slide between base and tip{hint}."
            )
        if one.name in self.coupled:
            other, line = self.coupled[one.name]
            to = f"to {short(other)} " if other else ""
            raise InputError(
                f"{at} is coupled {to}by <equality> in line {line}; expected joints that move by themselves."
            )

    def _moving(self, one: _Joint, origin: Array) -> Joint:
        try:
            return Joint(one.name, one.kind, origin, one.axis, one.lower, one.upper)
        except InputError as error:
            text = str(error)
            raise InputError(f"{self.where}, line {one.line}: {text[0].lower()}{text[1:]}") from error

    def _against_gravity(self, base: str) -> Array | None:
        """Return the direction against gravity in the base at the reference posture; None without gravity."""
        size = float(np.linalg.norm(self.gravity))
        if size < 1e-9:
            return None
        T: Array = np.eye(4)
        for name in self._up(base)[::-1]:
            T = T @ self.frames[name].origin
        return np.asarray(-inverse(T)[:3, :3] @ self.gravity / size)


def _replaced(by_class: Mapping[str, str], own: Mapping[str, str]) -> dict[str, str]:
    """Return attributes over those of a class; an orientation takes the place of another one."""
    oriented = any(name in own for name in ORIENTATIONS)
    return {name: value for name, value in by_class.items() if not (oriented and name in ORIENTATIONS)} | dict(own)
