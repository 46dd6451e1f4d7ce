"""`METHODS`, the registry of estimators by name, in the order of publication."""

from __future__ import annotations

from ..core.geometry.se3 import Array
from ..errors import InputError, among
from .andreff import ANDREFF
from .dual_quaternions import CONDURACHE, DANIILIDIS, FOURDPA, LU
from .gwak import GWAK
from .heller import HELLER
from .method import Method
from .nguyen import METHOD as NGUYEN
from .pairs import MotionsLike
from .robot_world import LI, SHAH, RobotWorldMethod
from .scaled import solve_4dpa
from .separated import CHOU, HORAUD, PARK, SHIU, TSAI
from .zhang import ZHANG
from .zhao import METHOD as ZHAO

_PUBLISHED = (TSAI, SHIU, CHOU, PARK, HORAUD, DANIILIDIS, ANDREFF, LU, GWAK, HELLER, CONDURACHE)
METHODS: dict[str, Method] = {method.name: method for method in (*_PUBLISHED, ZHANG, ZHAO, NGUYEN, FOURDPA)}

# Estimators of X and W together from poses; `calibrate` knows them too, `solve` does not.
ROBOT_WORLD_METHODS: dict[str, RobotWorldMethod] = {method.name: method for method in (LI, SHAH)}


def find(name: str) -> Method:
    """The method of that name, or an `InputError` that lists the names."""
    if among(name, ROBOT_WORLD_METHODS):
        raise InputError(
            f"Method {name!r} solves G X C = W on poses: call calibrate() or ROBOT_WORLD_METHODS[{name!r}]."
        )
    if not among(name, METHODS):
        known = ", ".join(METHODS)
        on_poses = " or ".join(ROBOT_WORLD_METHODS)
        raise InputError(f"Expected `method` to be one of {known} (or {on_poses}, on poses), got {name!r}.")
    return METHODS[name]


def solve(A: MotionsLike, B: MotionsLike, *, method: str = "4dpa", scale: float | None = None) -> Array:
    """X from ``A_i X = X B_i`` by any method of `METHODS`.

    Parameters
    ----------
    A, B : (..., N, 4, 4)
        Relative motions of robot and camera (`relative_motions`), arrays or SciPy ``RigidTransform``;
        leading axes are independent problems and broadcast.
    method : str
        A name in `METHODS`.
    scale : float or None
        Of 4DPA only: the scaling factor d of the map to SO(4), in the length unit of the translations; None is the
        limit d -> infinity in closed form. A finite d truncates X by the order of 1/d^2 and rounds it by d eps;
        d of about 1e5 lengths balances the two.

    Returns
    -------
    X : (..., 4, 4)
        In SE(3). At finite d the upper left block of the rotation on SO(4) is orthonormalised
        (Sub-problem 1), a change of the order of 1/d^2.

    Raises
    ------
    InputError
        Wrong shapes, values or fewer than two motions; an unknown method.
    DegenerateMotionError
        The motions do not determine X (parallel rotation axes, no rotation), or not by this method.
    NotConvergedError
        An iterative method did not converge; ``METHODS[name].estimate`` gives what it reached, with a flag.

    Examples
    --------
    >>> import numpy as np, uq_handeye as uq
    >>> poses = uq.simulate(n_poses=8, seed=1)
    >>> motions = uq.relative_motions(poses)
    >>> bool(np.allclose(uq.solve(motions.A, motions.B), poses.truth.X))
    True
    >>> bool(np.allclose(uq.solve(motions.A, motions.B, method="park"), poses.truth.X))
    True
    """
    if method == "4dpa":
        return solve_4dpa(A, B, scale)
    found = find(method)
    if scale is not None:
        raise InputError(f"Expected no `scale` with method {method!r}: it is the scaling factor of 4dpa.")
    return found(A, B)
