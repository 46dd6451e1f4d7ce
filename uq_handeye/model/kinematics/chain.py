r"""A serial chain of joints: poses of its tip, their derivatives by joints and by errors of the kinematics.

Model (K1): from base to tip the fixed transforms O_k (from the frame of the previous joint, after it moved, to that of
joint k), motions M_k about (revolute, rad) or along (prismatic, m) the axis z_k, and the tip's transform O_tip:

    T(q; e) = O_1 E_1 M_1(q'_1)  O_2 E_2 M_2(q'_2)  ..  O_L E_L M_L(q'_L)  O_tip        base_T_tip

e = 0 is the nominal chain; `errors` has its numbers. With P_k = O_1 M_1 .. O_k = (R_k, p_k), z along the axis of joint
k, and t the position of the tip, the twist of the pose, ``(theta, tau)``: left rotation (rad) and additive translation
(m), both in the base frame, is by e_k = (a_k, l_k) and by q_k

    F_k = [[R_k, 0], [-[t - p_k]x R_k, R_k]]      J_k = (z_k; z_k x (t - p_k)) revolute,  (0; z_k) prismatic

and by the joint functions J_k times sin q_k, cos q_k, sin 2q_k, cos 2q_k and g_k(q) (`gravity`). At e other than zero
the derivatives are those of the exact poses: with P_k after E_k, R_k times the right Jacobian of exp(a_k) for a_k and
R_k exp(-a_k) for l_k.

*Sign.* e corrects the nominal model, true = T(q; e); the error of a pose that was computed without it is -F e.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.files.json_values import JsonObject
from ...core.files.open import StrPath
from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array, left_jacobian
from ...core.presentation.units import parse_angle, parse_length
from ...core.read_only import ReadOnlyArrays
from ...core.rounding import CHAIN_ROUNDING, PRODUCT_ROUNDING
from ...errors import InputError, require_known
from ..errors.joint_covariance import JointCovariance
from .descriptions.dh import read_dh
from .descriptions.mjcf import read_mjcf
from .descriptions.universal_robots import read_ur_calibration
from .descriptions.urdf import read_urdf
from .errors import (
    LENGTHS,
    OFFSETS,
    SAG,
    TILTS,
    TRANSMISSION,
    ErrorLayout,
    ErrorParameter,
    MoreDeviations,
    checked_sd,
    error_layout,
    harmonic_rates,
    harmonics,
)
from .forward import (
    Frames,
    axis_twists,
    fixed_transforms,
    forward,
    load_rates,
    loads,
    rotations,
    spread_postures,
    turned,
)
from .joint import MAX_JOINTS, ChainParts, checked_origin, parts_from_dict, parts_to_dict, require_name
from .joint import Joint as Joint
from .known_arms import arm_names, known_arm

# Number of postures that are computed together: their frames fit the cache.
POSTURES_PER_BLOCK = 256

Flange = Literal["controller", "physical"]


@dataclass(frozen=True, eq=False)
class Kinematics(ReadOnlyArrays):
    """A serial arm: its joints from base to tip, as its maker says they are.

    Joint values ``q`` are (..., L), rad for revolute and m for prismatic joints, in the order of `names`; errors ``e``
    are (m,) or (..., m), in the order of `errors`. Leading axes broadcast.

    Parameters
    ----------
    name : str
    base, tip : str
        Names of the frames between which the poses are.
    joints : tuple of Joint
        In order from base to tip.
    end : (4, 4) m
        The tip in the frame of the last joint after it has moved.
    up : (3,)
        Direction against gravity in the base frame, for the sag; made a unit vector.
    """

    name: str
    base: str
    tip: str
    joints: tuple[Joint, ...]
    end: Array
    up: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    def __post_init__(self) -> None:
        for part in ("name", "base", "tip"):
            require_name(getattr(self, part), f"`{part}` of the kinematics")
        joints = tuple(self.joints)
        if not 1 <= len(joints) <= MAX_JOINTS or not all(isinstance(joint, Joint) for joint in joints):
            raise InputError(f"Expected `joints` of the kinematics to be 1 to {MAX_JOINTS} joints, got {len(joints)}.")
        names = [joint.name for joint in joints]
        if twice := [name for name in names if names.count(name) > 1]:
            raise InputError(f"Expected joints of different names, got two of the name {twice[0]}.")
        object.__setattr__(self, "joints", joints)
        object.__setattr__(self, "end", checked_origin(self.end, "`end` of the kinematics"))
        up = as_numbers(self.up, "up")
        length = float(np.linalg.norm(up)) if up.shape == (3,) else np.nan
        if not 1e-9 < length < 1e9:
            raise InputError(f"Expected `up` to be a direction of 3 numbers, got {np.shape(self.up)} {self.up!r:.60}.")
        object.__setattr__(self, "up", up if abs(length - 1.0) < PRODUCT_ROUNDING else up / length)
        super().__post_init__()

    @classmethod
    def from_urdf(
        cls,
        path_or_text: StrPath,
        base: str | None = None,
        tip: str | None = None,
        *,
        up: ArrayLike | None = None,
    ) -> Kinematics:
        """Read the chain from ``base`` to ``tip`` of a URDF: a file, or its text if it starts with ``<``.

        Left out, ``base`` is the root link and ``tip`` the one leaf behind a moving joint. Fixed joints are folded
        into the next origin; mimic, floating and planar joints between base and tip, loops and xacro are refused, by
        name. Lengths are in m, angles in rad, as URDF has it. ``up`` is the direction against gravity in the base
        (z).
        """
        return cls._from_parts(read_urdf(path_or_text, base, tip), up)

    @classmethod
    def from_mjcf(
        cls,
        path_or_text: StrPath,
        base: str | None = None,
        tip: str | None = None,
        *,
        up: ArrayLike | None = None,
    ) -> Kinematics:
        """Read the chain from ``base`` to ``tip`` of an MJCF model: a file, or its text if it starts with ``<``.

        Left out, ``base`` is the world and ``tip`` the one body at an end behind a moving joint; the tip may be a site.
        Joint values are MuJoCo's ``qpos``, in rad and m. Ball and free joints, joints that an ``<equality>`` couples,
        and models of several files are refused, by name. ``up`` is the direction against gravity in the base; left
        out, the opposite of the gravity of the file.
        """
        return cls._from_parts(read_mjcf(path_or_text, base, tip), up)

    @classmethod
    def from_dh(
        cls,
        table: Any,
        convention: Literal["standard", "modified"] | None = None,
        *,
        names: Sequence[str] | None = None,
        kinds: Sequence[str] | None = None,
        limits: ArrayLike | None = None,
        angle: str | None = None,
        length: str | None = None,
        up: ArrayLike | None = None,
    ) -> Kinematics:
        """Make the chain of Denavit-Hartenberg parameters.

        Parameters
        ----------
        table : (L, 4) theta, d, a, alpha; rows as dicts; or path of a CSV or TOML file
            A file has the columns (keys) joint, theta, d, a, alpha, and if need be type, lower, upper, offset.
        convention : "standard" or "modified"
            ``Rz(q + theta) Tz(d) Tx(a) Rx(alpha)``, or Craig's ``Rx(alpha) Tx(a) Rz(q + theta) Tz(d)`` with a and alpha
            of the link before. Left out, a file must say it; arrays are standard.
        names, kinds : (L) str
            Of an array: names of the joints (joint_1, ...), and "revolute" (all), "prismatic" or "fixed".
        limits : (L, 2)
            Of an array, in the units of the table.
        angle, length : str
            Units of numbers that carry none, such as "deg" and "mm"; left out, rad and m, and numbers that are too
            large for these are refused.
        up : (3,)
            Direction against gravity in the base; left out, what the file says, else z.
        """
        parts = read_dh(table, convention, names=names, kinds=kinds, limits=limits, angle=angle, length=length)
        return cls._from_parts(parts, up)

    @classmethod
    def from_ur_calibration(
        cls,
        path: StrPath,
        urdf: StrPath | None = None,
        base: str | None = None,
        tip: str | None = None,
        *,
        prefix: str = "",
        up: ArrayLike | None = None,
    ) -> Kinematics:
        """Read the calibrated kinematics of a Universal Robots arm, the YAML file of ``ur_calibration``.

        ``base`` is ``base`` (the controller's, left out) or ``base_link``, ``tip`` is ``tool0`` (left out) or
        ``flange``; with ``urdf`` they are any of its links, and the origins of its six joints are replaced by those of
        the file. ``prefix`` precedes the names of the joints.
        """
        return cls._from_parts(read_ur_calibration(path, urdf, base, tip, prefix), up)

    @classmethod
    def from_name(cls, name: str, *, up: ArrayLike | None = None) -> Kinematics:
        """Return the nominal chain of a common arm, such as "ur5e": base and flange of its controller.

        Case, spaces, ``-``, ``_`` and ``/`` in the name do not matter; `arm_names` has the names. ``up`` is the
        direction against gravity in the base (z).
        """
        return cls._from_parts(known_arm(name).parts, up)

    @staticmethod
    def arm_names() -> tuple[str, ...]:
        """Names that `from_name` knows."""
        return arm_names()

    @classmethod
    def _from_parts(cls, parts: ChainParts, up: ArrayLike | None) -> Kinematics:
        said = parts.up if up is None else as_numbers(up, "up")
        up = np.array([0.0, 0.0, 1.0]) if said is None else np.array(said)
        return cls(parts.name, parts.base, parts.tip, parts.joints, parts.end, up)

    @property
    def names(self) -> tuple[str, ...]:
        """(L) names of the joints, from base to tip."""
        return tuple(joint.name for joint in self.joints)

    @property
    def n_joints(self) -> int:
        """L, the number of moving joints."""
        return len(self.joints)

    @property
    def errors(self) -> tuple[ErrorParameter, ...]:
        """(m) the numbers of e, in the order of the columns."""
        return self._layout.parameters

    @cached_property
    def limits(self) -> Array:
        """(L, 2) lower and upper limit of each joint, rad or m; -inf and inf where there is none."""
        found = np.array([(joint.lower, joint.upper) for joint in self.joints])
        found.flags.writeable = False
        return found

    @cached_property
    def reach(self) -> float:
        """Largest distance (m) of the tip from the first joint, over postures spread over the joint limits."""
        return self._extent[0]

    def poses(self, q: ArrayLike, e: ArrayLike | None = None) -> Array:
        """Return base_T_tip (..., 4, 4), exact in e."""

        def tip(posture: _Posture) -> Array:
            T = np.zeros((posture.q.shape[1], 4, 4))
            T[:, :3] = np.moveaxis(posture.true.tip, -1, 0)
            T[:, 3, 3] = 1.0
            return T

        return self._evaluate(tip, (4, 4), q, e)

    def frames(self, q: ArrayLike, e: ArrayLike | None = None) -> Array:
        """Return the frames P_k (..., L, 4, 4) of the joints in the base, before they move, z along their axes.

        x and y come from the frame of the joint by the smallest rotation of its z to its axis. With ``e``, the frames
        after E_k, whose z is the true axis.
        """

        def joints(posture: _Posture) -> Array:
            T = np.zeros((posture.q.shape[1], self.n_joints, 4, 4))
            T[..., :3, :3] = np.moveaxis(posture.true.R, -1, 0)
            T[..., :3, 3] = np.moveaxis(posture.true.p, -1, 0)
            T[..., 3, 3] = 1.0
            return T

        return self._evaluate(joints, (self.n_joints, 4, 4), q, e)

    def jacobian(self, q: ArrayLike, e: ArrayLike | None = None) -> Array:
        """Return the twist (..., 6, L) of base_T_tip per rad (m) of each joint: left rotation, then translation."""

        def rates(posture: _Posture) -> Array:
            twists = axis_twists(posture.true, self.revolute)
            if posture.e is not None:  # d q'_k / d q_j
                e, layout = posture.e, self._layout
                own = (harmonic_rates(posture.q.T) * layout.spread(e, layout.harmonics, 4)).sum(axis=-1)
                sag = layout.spread(e, layout.sags, 1)[..., 0]
                passed = load_rates(posture.nominal, self.revolute, self.up) / self._largest_loads[:, None, None]
                change = sag.T[:, None] * passed * self._loaded[:, None, None]
                twists = twists * (1.0 + own.T)[:, None] + np.einsum("kin,kjn->jin", twists, change)
            return twists.transpose(2, 1, 0)

        return self._evaluate(rates, (6, self.n_joints), q, e)

    def columns(self, q: ArrayLike, e: ArrayLike | None = None) -> Array:
        """Return F (..., 6, m): twist of the true pose per unit (rad or m) of each number of e, at e (0 if left out).

        Left rotation, then additive translation, in the base frame.
        """

        def effects(posture: _Posture) -> Array:
            layout, motion, lever = self._layout, posture.true, posture.true.levers()
            about, along = motion.R, motion.R
            if posture.a is not None:
                back = -np.moveaxis(posture.a, 1, -1)  # (L, n or 1, 3)
                right_jacobian = np.moveaxis(left_jacobian(back), 1, -1)
                about = np.einsum("kijn,kjcn->kicn", motion.R, np.broadcast_to(right_jacobian, motion.R.shape))
                along = np.einsum("kijn,kjcn->kicn", motion.R, np.broadcast_to(rotations(-posture.a), motion.R.shape))
            moments = turned(about, lever)
            twists = axis_twists(motion, self.revolute)
            out = np.zeros((len(layout.parameters), 6, posture.q.shape[1]))
            for columns, top, bottom in ((layout.turns, about, moments), (layout.shifts, None, along)):
                at = (layout.joint[columns], slice(None), layout.part[columns])
                if top is not None:
                    out[columns, :3] = top[at]
                out[columns, 3:] = bottom[at]
            for columns, values in (
                (layout.harmonics, np.moveaxis(harmonics(posture.q), -1, 1)),  # (L, 4, n)
                (layout.sags, posture.loads[:, None]),
            ):
                joint = layout.joint[columns]
                out[columns] = twists[joint] * values[joint, layout.part[columns], None]
            return out.transpose(2, 1, 0)

        return self._evaluate(effects, (6, len(self.errors)), q, e)

    def gravity(self, q: ArrayLike) -> Array:
        """Return g (..., L), the load of unit weights on each joint over its largest within the joint limits.

        Unit weights at the following joint frames and the tip, in the nominal chain; positive where they push the
        joint forward. 0 for a joint that gravity does not load.
        """
        return self._evaluate(lambda posture: posture.loads.T, (self.n_joints,), q, None)

    def covariance(
        self,
        q: ArrayLike,
        joint_sd: float | str | ArrayLike = 0.0,
        angle_sd: float | str = 0.0,
        length_sd: float | str = 0.0,
        *,
        flange: Flange = "controller",
        **more: Unpack[MoreDeviations],
    ) -> JointCovariance:
        """Return the joint covariance of n poses that were computed from joints q (n, L) by the nominal chain.

        ``own = J diag(joint_sd^2) J^T`` and the shared columns ``-F sd``, named as the numbers of e; those whose
        standard deviation is 0 are left out.

        Parameters
        ----------
        joint_sd : float, text or (L,)
            Noise of each joint reading in each pose, rad; for prismatic joints the number counts in m.
        angle_sd : float or text
            Standard deviation of offsets and tilts, rad, where ``offset_sd`` and ``tilt_sd`` are left out.
        length_sd : float or text
            Of each link length, m.
        offset_sd, tilt_sd, transmission_sd, sag_sd : float or text
            Of the joint offsets, the tilts of the joint axes, each harmonic and the largest sag, rad; the sag of a
            prismatic joint counts in m.
        flange : "controller" or "physical"
            "controller" leaves out the gauge columns, which X and W absorb: X is then that of the flange at which the
            controller's joints read true. "physical" keeps them.

        Raises
        ------
        InputError
            For values that are no standard deviations, and for joints of another number.
        """
        values = np.asarray(self._joint_values(q))
        if values.ndim < 2:
            raise InputError(f"Expected `q` to have shape (n, {self.n_joints}), got {values.shape}.")
        if flange not in ("controller", "physical"):
            raise InputError(f"Expected `flange` to be controller or physical, got {flange!r}.")
        angle = checked_sd(angle_sd, "angle_sd", parse_angle)
        require_known("covariance", more, MoreDeviations)
        of: dict[str, Any] = {
            name: checked_sd(value, name, parse_angle) for name, value in more.items() if value is not None
        }
        sds = {
            OFFSETS: of.get("offset_sd", angle),
            TILTS: of.get("tilt_sd", angle),
            LENGTHS: checked_sd(length_sd, "length_sd", parse_length),
            TRANSMISSION: of.get("transmission_sd", 0.0),
            SAG: of.get("sag_sd", 0.0),
        }
        sd = np.array([sds[error.group] * (flange == "physical" or not error.gauge) for error in self.errors])
        noise = np.array(as_numbers(checked_sd(joint_sd, "joint_sd", parse_angle), "joint_sd"))
        if noise.shape not in ((), (self.n_joints,)):
            raise InputError(f"Expected `joint_sd` to be one number or {self.n_joints}, got shape {noise.shape}.")
        kept = np.flatnonzero(sd)
        J = self.jacobian(values) * noise
        F = self.columns(values)[..., kept] * -sd[kept]
        return JointCovariance(J @ J.mT, F, tuple(self.errors[k].key for k in kept))

    def to_dict(self) -> JsonObject:
        """Return the nominal chain as plain text and numbers, for files; None is a limit that does not exist."""
        return parts_to_dict(ChainParts(self.name, self.base, self.tip, self.joints, self.end, self.up))

    @classmethod
    def from_dict(cls, data: Any) -> Kinematics:
        """Return the chain that `to_dict` wrote; raises `InputError` for anything else."""
        parts = parts_from_dict(data)
        return cls._from_parts(parts, parts.up)

    @cached_property
    def _layout(self) -> ErrorLayout:
        return error_layout(self.joints)

    @cached_property
    def _fixed(self) -> Array:
        return fixed_transforms(self.joints, self.end)

    @cached_property
    def revolute(self) -> NDArray[np.bool_]:
        """(L,) whether a joint turns."""
        return np.array([joint.is_revolute for joint in self.joints])

    def spread(self, n: int = 2048) -> Array:
        """(n, L) joints that fill the limits evenly, always the same ones (`spread_postures`)."""
        return spread_postures(self.limits, self.revolute, n)

    @cached_property
    def _extent(self) -> tuple[float, Array]:
        """The reach (m), and the largest load of each joint (L,), over postures spread over the limits."""
        q = self.spread()
        motion = forward(self._fixed, self.revolute, np.ascontiguousarray(q.T))
        reach = float(np.linalg.norm(motion.tip[:, 3] - motion.p[0], axis=0).max())
        return reach, np.abs(loads(motion, self.revolute, self.up)).max(axis=1)

    @cached_property
    def _loaded(self) -> NDArray[np.bool_]:
        """(L,) whether gravity loads the joint at all."""
        size = np.where(self.revolute, max(self.reach, 1e-12), 1.0) * self.n_joints
        return np.asarray(self._extent[1] > CHAIN_ROUNDING * size)

    @cached_property
    def _largest_loads(self) -> Array:
        return np.where(self._loaded, self._extent[1], 1.0)

    def _joint_values(self, q: ArrayLike) -> Array:
        values = as_numbers(q, "q")
        if values.ndim < 1 or values.shape[-1] != self.n_joints:
            raise InputError(
                f"Expected `q` to have shape (..., {self.n_joints}), a value per joint, got {values.shape}."
            )
        if not np.isfinite(values).all():
            raise InputError("Expected `q` to hold finite joint values, got NaN or infinity.")
        return values

    def _evaluate(
        self, function: Callable[[_Posture], Array], shape: tuple[int, ...], q: ArrayLike, e: ArrayLike | None
    ) -> Array:
        """Values of that shape at all postures, block by block."""
        values, errors = self._joint_values(q), None
        lead = values.shape[:-1]
        if e is not None:
            errors = as_numbers(e, "e")
            m = len(self.errors)
            if errors.ndim < 1 or errors.shape[-1] != m or not np.isfinite(errors).all():
                raise InputError(f"Expected `e` to be finite numbers of shape (..., {m}), got shape {errors.shape}.")
            try:
                lead = np.broadcast_shapes(lead, errors.shape[:-1])
            except ValueError:
                raise InputError(
                    f"Expected leading axes of `q` and `e` that broadcast, got {values.shape} and {errors.shape}."
                ) from None
            one = errors.size == m
            errors = errors.reshape(1, m) if one else np.broadcast_to(errors, (*lead, m)).reshape(-1, m)
        flat = np.broadcast_to(values, (*lead, self.n_joints)).reshape(-1, self.n_joints)
        out = np.empty((len(flat), *shape))
        for start in range(0, len(flat), POSTURES_PER_BLOCK):
            part = slice(start, start + POSTURES_PER_BLOCK)
            of_part = errors if errors is None or len(errors) == 1 else errors[part]
            out[part] = function(_Posture(self, np.ascontiguousarray(flat[part].T), of_part))
        return out.reshape(*lead, *shape)


class _Posture:
    """Some postures q (L, n) with errors e (n or 1, m): with frames and loads that are computed once."""

    def __init__(self, chain: Kinematics, q: Array, e: Array | None) -> None:
        self.chain, self.q, self.e = chain, q, e
        self.a = self.shift = None
        if e is not None:
            layout = chain._layout
            self.a = np.moveaxis(layout.spread(e, layout.turns, 3), 0, -1)  # (L, 3, n or 1)
            self.shift = np.moveaxis(layout.spread(e, layout.shifts, 3), 0, -1)

    @cached_property
    def nominal(self) -> Frames:
        return forward(self.chain._fixed, self.chain.revolute, self.q)

    @cached_property
    def loads(self) -> Array:
        """(L, n) g."""
        chain = self.chain
        raw = loads(self.nominal, chain.revolute, chain.up)
        return np.where(chain._loaded[:, None], raw / chain._largest_loads[:, None], 0.0)

    @cached_property
    def true(self) -> Frames:
        if self.e is None:
            return self.nominal
        layout = self.chain._layout
        change = (harmonics(self.q.T) * layout.spread(self.e, layout.harmonics, 4)).sum(axis=-1).T
        sag = layout.spread(self.e, layout.sags, 1)[..., 0].T
        if sag.any():
            change = change + sag * self.loads
        return forward(self.chain._fixed, self.chain.revolute, self.q + change, self.a, self.shift)
