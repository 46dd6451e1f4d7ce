r"""Choosing poses by the posterior of a calibration: its covariance so far is the one that the calibration states.

A pose at which the camera pose will be measured with the derivatives A by all errors s of the posterior, and with its
own noise ``L L^T`` (what is drawn again, and what of the arm is unknown again there), adds the information ``B^T B``,
``B = L^-1 A`` (`posterior.selection`). More poses do not average what all of them share: it is among s.
"""

from __future__ import annotations

from ..calibration.result import Calibration
from ..geometry.se3 import Array
from ..noise.models import PoseNoise
from ..noise.square_roots import cholesky_of, whiten
from ..posterior.selection import Selection
from ..prediction.predict import CameraAhead, own_noise


def chosen_by(result: Calibration, ahead: CameraAhead, k: int, Q: Array | None, repeat: bool) -> Selection:
    """Return the k of the poses ahead that make the criterion (`posterior.selection`) small."""
    assert result.posterior is not None
    rows = whiten(cholesky_of(ahead.noise + ahead.unseen), ahead.columns)
    return result.posterior.choose(rows, k, Q, repeat=repeat)


def noise_of_new(result: Calibration) -> PoseNoise:
    """Return the noise (6, 6) of each new pose."""
    return PoseNoise(own_noise(result, "robot"), own_noise(result, "camera"))
