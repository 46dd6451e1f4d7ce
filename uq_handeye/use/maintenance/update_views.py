"""Update of the result of a rig: the old and the new views calibrated together."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ...calibration.calibrate_rig import OPTIONS, calibrate_rig
from ...calibration.evidence.new_views import like
from ...calibration.rig_result import RigCalibration
from ...core.files.tree_values import is_plain_number
from ...core.levels import CONTRADICTED
from ...errors import InputError, NotConvergedError
from ...findings import Finding
from ...fit.graph.declared import request_from_dict
from ...model.rig.description import Rig
from ...model.shared_errors.assumed import replace_defaults
from ...model.shared_errors.shared_error import SharedError
from .check import check
from .check_text import refusal_of_update


def update_rig(result: RigCalibration, rig: Rig, *, although_changed: bool = False) -> RigCalibration:
    """Calibrate the old and the new views together.

    Parameters
    ----------
    result : RigCalibration
    rig : Rig
        New robot poses and views. Poses that the result has too must be the same, or all others: these count as later.
    although_changed : bool
        Update even if the new views contradict the result.

    Raises
    ------
    InputError
        New views that contradict the result, that it already has, or of cameras or targets that the rig does not have.
    """
    rig, later = _numbered_on(result.rig, rig)
    new = like(result, rig)
    have = {(view.camera, view.target, moment) for view in result.rig.views for moment in view.at or ()}
    for view in new.views:
        if again := [moment for moment in view.at or () if (view.camera, view.target, moment) in have]:
            raise InputError(
                f"{view.words} has the view of {view.target} by {view.camera} at robot pose {again[0]!s}, which the "
                "calibration has already. Remove it, or rename the pose."
            )
    if not although_changed:
        found = check(result, rig, level=CONTRADICTED.probability)
        if found.changed:
            error = refusal_of_update(found)
            with suppress(InputError, NotConvergedError):
                after = _calibrated_with(result, new).findings
                error.findings = tuple(one for one in after if one.severity == "failure" and one.explains) or (
                    error.findings
                )
            raise error
    updated = _calibrated_with(result, new)
    said = [] if later is None else [Finding("maintenance.later_numbers", "note", {"later": later})]
    return replace(updated, findings=(*updated.findings, *said))


def _numbered_on(old: Rig, new: Rig) -> tuple[Rig, int | None]:
    """Return a rig with its moments after those of an old one, and by how much they are later; None: as they are.

    Files number their rows from 0, and whole seconds from the start of a session: moments of two sessions then have the
    same numbers. They are others where no robot pose of one session is that of the other by its number.
    """
    before: list[Any] = old.moments
    moments: list[Any] = new.moments
    others = [old.arms[name].has_others_at_names_of(arm) for name, arm in new.arms.items() if name in old.arms]
    if True not in others or False in others or not all(map(is_plain_number, (*before, *moments))):
        return new, None
    later = int(np.ceil(before[-1] - moments[0])) + 1  # a whole number: rows stay rows
    moved = {moment: moment + later for moment in moments}
    arms = {name: replace(arm, names=tuple(moved[at] for at in arm.names)) for name, arm in new.arms.items()}
    views = (replace(view, at=tuple(moved[moment] for moment in view.at or ())) for view in new.views)
    return replace(new, arms=arms, views=tuple(views)), later


def _calibrated_with(result: RigCalibration, new: Rig) -> RigCalibration:
    """Return the calibration of the old and the new views, with the options of the result."""
    if result.provenance is None or result.provenance.request is None:
        raise InputError("Expected a result that says how it was calibrated. Calibrate again.")
    plain = result.provenance.request
    noise, request = plain["noise"], request_from_dict(plain)
    if noise is not None:
        noise = {name: np.array(of) if np.ndim(of) > 1 else of for name, of in noise.items()}
    asked = {name: getattr(request, name) for name in OPTIONS}
    shared = plain["shared"] if request.shared is None else _declared_again(plain["shared"], request.shared)
    return replace(calibrate_rig(result.rig.joined(new), noise, shared=shared, **asked), about=result.about)


def _declared_again(kinds: Any, errors: Sequence[SharedError]) -> list[SharedError]:
    """Return errors that were declared with those switched off that were left out."""
    off = [] if kinds is True else [error for error in replace_defaults((), False, False)
                                    if error.key.kind not in (kinds or ())]  # fmt: skip
    return [*errors, *(error for error in off if error.key not in {one.key for one in errors})]
