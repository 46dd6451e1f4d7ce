"""Noise of new poses and views of a calibrated rig, with the columns of the errors of its posterior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...errors import InputError
from ...fit.graph.declared import declared_of, request_from_dict
from ...fit.graph.graph import Graph
from ...fit.graph.noise import RigNoise, given_covariances, given_key
from ...fit.graph.posterior import Posterior
from ...fit.graph.request import Request
from ...fit.graph.sizes import WIDTH, components_of
from ...model.errors.cholesky import symmetric_factor
from ...model.errors.key import ErrorKey, Owner
from ...model.errors.keys import CLOCK_OFFSET, ROBOT_ACCURACY
from ...model.errors.sizes import Size
from ...model.errors.term import ErrorTerm
from ...model.poses.pose_pairs import PosePairs
from ...model.rig.description import Rig
from ...model.shared_errors.assumed import assumed_accuracy
from ...model.shared_errors.view import HALF_WIDTH
from ..rig_poses import RigPoses


def posterior_of(result: RigPoses) -> Posterior:
    """Return the posterior of a result; raises `InputError` where it has none."""
    if result.posterior is None:
        raise InputError("Expected the result of a rig with its posterior. Calibrate again.")
    return result.posterior


def new_noise(result: RigPoses, rig: Rig, graph: Graph, measured: bool | None = None) -> RigNoise:
    """Return the noise of new poses and the columns of the shared errors.

    The noise is that of the estimated components at each new pose; where it was given, the mean of each arm and camera.
    ``measured``: as in `parts_of`.
    """
    posterior, parts = posterior_of(result), parts_of(result, rig, graph, measured)
    robot, camera = np.zeros((graph.P, 6, 6)), np.zeros((graph.E, 6, 6))
    if not result.components:
        mean = {one.key: one.covariance for one in posterior.noise}
        for k, name in enumerate(rig.arms):
            robot[graph.arm == k] = mean.get(given_key("robot", name), np.zeros((6, 6)))
        for k, name in enumerate(rig.cameras):
            camera[k == graph.X] = mean.get(given_key("camera", name), 0.0)
    blocks = parts if result.components else [one for one in parts if one.key.of("") == ROBOT_ACCURACY]
    noise = RigNoise.of_own(robot, camera).with_blocks(blocks if result.components or measured is not None else ())
    given, some = given_covariances(rig, graph)
    noise = replace(noise, camera=np.where(some[:, None, None], given, noise.camera))
    # the drift of another session is another one, whose motion is in the covariance of the poses
    known = [one for one in parts if set(one.keys) <= posterior.place.keys() and one.key.owner != Owner.SESSION]
    return noise.with_columns(known).in_order(posterior.keys)


def parts_of(result: RigPoses, rig: Rig, graph: Graph, measured: bool | None = None) -> tuple[ErrorTerm, ...]:
    """Return the components of new poses, with the estimated sizes as known ones.

    ``measured``: whether views at other robot poses are measured; what the poses so far do not say of an arm's errors
    is noise of each of these poses (`BoundPopulation.unseen`). None: the poses are those of the calibration.
    """
    lines = {ErrorKey.from_dict(part["key"]): part["size"] for part in result.components}
    keys = posterior_of(result).place.keys()
    if not (lines or keys):
        return ()
    before = result.rig, Graph.of(result.rig)
    plain = None if result.provenance is None else result.provenance.request
    request = Request() if plain is None else request_from_dict(plain)
    request = replace(request, shared=[error for error in request.shared or () if error.key.of("") != CLOCK_OFFSET])
    width = lines.get(WIDTH, HALF_WIDTH) / HALF_WIDTH
    found = components_of(rig, graph, True, before, width, request=replace(request, sizes=None, prior=None))
    known = [one for one in found if one.key in lines or set(one.keys) <= keys]
    if measured is not None:
        measured = measured and bool(result.components)  # by noise that has a share of these errors
        known = [_with_unseen(one, rig, graph, before, request, measured) for one in known]
    return tuple(replace(one, size=Size(lines.get(one.key, one.size.median))) for one in known)


def _with_unseen(
    part: ErrorTerm, rig: Rig, graph: Graph, before: tuple[Rig, Graph], request: Request, measured: bool
) -> ErrorTerm:
    """Return the accuracy of an arm with its errors at new poses of which those ``before`` say nothing."""
    if part.key.of("") != ROBOT_ACCURACY:
        return part
    of, old = (k.arm == list(r.arms).index(part.key.name) for r, k in ((rig, graph), before))
    error = declared_of(request.shared or (), part.key)
    error = assumed_accuracy() if error is None or error.is_exact else error
    T, T_old = graph.robot[of], before[1].robot[old]
    unseen = error.bound(PosePairs(T_old, T_old)).unseen
    assert unseen is not None
    block = np.zeros((graph.P, 6, 6))
    block[of] = symmetric_factor(unseen(PosePairs(T, T), measured))
    return replace(part, block=block)
