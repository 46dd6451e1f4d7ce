"""Noise of new poses and views of a calibrated rig, with the columns of the errors of its posterior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...errors import InputError
from ...fit.graph.graph import Graph
from ...fit.graph.noise import RigNoise, given_covariances, given_key
from ...fit.graph.sizes import WIDTH, components_of
from ...fit.one_model.declared import request_from_dict
from ...fit.one_model.request import Request
from ...model.error_terms.key import ErrorKey
from ...model.error_terms.keys import CLOCK_OFFSET
from ...model.error_terms.sizes import Size
from ...model.error_terms.term import ErrorTerm
from ...model.posterior.posterior import Posterior
from ...model.rig.description import Rig
from ...model.shared_errors.view import HALF_WIDTH
from ..estimate.rig_poses import RigPoses


def posterior_of(result: RigPoses) -> Posterior:
    """Return the posterior of a result; raises `InputError` where it has none."""
    if result.posterior is None:
        raise InputError("Expected the result of a rig with its posterior. Calibrate again.")
    return result.posterior


def new_noise(result: RigPoses, rig: Rig, graph: Graph) -> RigNoise:
    """Return the noise of new poses and the columns of the shared errors.

    The noise is that of the estimated components at each new pose; where it was given, the mean of each arm and camera.
    """
    posterior = posterior_of(result)
    mean = {one.key: one.covariance for one in posterior.noise}
    own = {"robot": np.zeros((graph.P, 6, 6)), "camera": np.zeros((graph.E, 6, 6))}
    K = {side: np.zeros((*S.shape[:2], len(posterior.keys))) for side, S in own.items()}
    for part in parts_of(result, rig, graph):
        if part.columns is not None and set(part.keys) <= posterior.place.keys():
            K[part.side][:, :, [posterior.place[key] for key in part.keys]] = part.size.median * part.columns
        if part.block is not None and result.components:
            own[part.side] += part.size.median**2 * part.block @ part.block.mT
    for k, name in enumerate([] if result.components else rig.arms):
        own["robot"][graph.arm == k] = mean.get(given_key("robot", name), np.zeros((6, 6)))
    for k, name in enumerate([] if result.components else rig.cameras):
        own["camera"][k == graph.X] = mean.get(given_key("camera", name), 0.0)
    given, some = given_covariances(rig, graph)
    own["camera"][some] = given[some]
    return RigNoise(own["robot"], own["camera"], K["robot"], K["camera"], posterior.keys)


def parts_of(result: RigPoses, rig: Rig, graph: Graph) -> tuple[ErrorTerm, ...]:
    """Return the components of new poses, with the estimated sizes as known ones."""
    lines = {ErrorKey.from_dict(part["key"]): part["size"] for part in result.components}
    keys = posterior_of(result).place.keys()
    if not (lines or keys):
        return ()
    before = result.rig, Graph.of(result.rig)
    request = Request() if result.provenance is None else request_from_dict(result.provenance["request"])
    request = replace(request, shared=[error for error in request.shared or () if error.key.of("") != CLOCK_OFFSET])
    width = lines.get(WIDTH, HALF_WIDTH) / HALF_WIDTH
    found = components_of(rig, graph, True, before, width, request=replace(request, sizes=None, prior=None))
    known = [one for one in found if one.key in lines or set(one.keys) <= keys]
    return tuple(replace(one, size=Size(lines.get(one.key, one.size.median))) for one in known)
