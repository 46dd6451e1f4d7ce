"""A calibration as plain text: X with standard deviations, units on every number."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from ..se3 import Array, left_jacobian, skew
from .analysis_text import beside_lines, budget_lines, covariance_lines, diagnosis_lines, noise_lines, pose_lines

if TYPE_CHECKING:
    from ..result import Calibration

NAMES = ("rotation x", "rotation y", "rotation z", "translation x", "translation y", "translation z")
NOT_COVERED = (
    "The standard deviations are 1 sigma, to first order, of {source}. Systematic errors (wrong\n"
    "intrinsics, wrong robot kinematics) are not covered."
)
_SOURCES = {
    "model": "the noise given",
    "sandwich": "the residuals of the poses (sandwich)",
    "hac": "the residuals of the poses, neighbours correlated (hac)",
    "jackknife": "the poses left out one by one (jackknife)",
    "bootstrap": "the poses drawn with replacement (bootstrap)",
}


def summary(result: Calibration, threshold: float) -> str:
    """X, its inverse, standard deviations, correlations at or above ``threshold``, residuals, weakest direction."""
    frame = result.frame
    inverse_name = "_T_".join(reversed(frame.split("_T_"))) if "_T_" in frame else f"inv({frame})"
    origin = "" if result.n_poses is None else f" of {result.n_poses} poses"
    scale = "" if result.scale is None else f", d = {result.scale:g}"
    setup = "" if result.setup is None else f", {result.setup}"
    on_poses = result.fourdpa is not None and result.W is not None
    data = f"{result.n_poses} poses" if on_poses else f"{result.n_pairs} pairs{origin}"
    lines = [f"{frame} by {result.method}{scale} from {data}{setup}", ""]
    usual = [] if result.analysis is None else result.analysis.diagnostics.shared_errors()
    if wrong := [text for text in result.warnings if text not in usual]:
        lines.insert(1, f"CAUTION: {len(wrong)} warning(s) say that something looks wrong.")
    lines += [*_matrix(result.X), ""]

    rotation = Rotation.from_matrix(result.X[:3, :3])
    covariance = result.covariance
    theta = None if covariance is None else covariance[:3, :3]
    tau = None if covariance is None else covariance[3:, 3:]
    rotvec = rotation.as_rotvec()
    quaternion = result.quaternion
    lines += [
        _row("translation (mm)", "xyz", 1e3 * result.X[:3, 3], _std(tau, 1e3 * np.eye(3)), 4),
        _row("rotation vector (deg)", "xyz", np.degrees(rotvec), _std(theta, _rotvec_jacobian(rotvec)), 5),
        _row("quaternion", "xyzw", quaternion, _std(theta, _quaternion_jacobian(quaternion)), 7),
    ]
    if result.std is None:
        lines += [
            "",
            "Standard deviations: not determined. No noise was given (--robot-noise, --camera-noise), and the",
            "residuals show none.",
        ]
    else:
        lines += [
            _row("turn about axes (deg)", "xyz", None, np.degrees(result.std[:3]), 5),
            "",
            *_correlations(result, threshold),
        ]
        for what, unit, factor, weakest in (
            ("rotation about", "deg", 180 / np.pi, result.weakest_rotation),
            ("translation along", "mm", 1e3, result.weakest_translation),
        ):
            if weakest is not None:
                axis, deviation = weakest
                direction = ", ".join(f"{x:+.2f}" for x in axis)
                lines.append(
                    f"Weakest: {what} ({direction}) of the {frame.split('_T_')[0]} frame, "
                    f"+- {_digits(factor * deviation)} {unit}"
                )
    r = result.residuals
    looked_at = "the" if r.pairs == result.n_pairs else f"{r.pairs} of the {result.n_pairs}"
    lines += [
        "",
        f"Residuals of AX = XB over {looked_at} pairs (how well X explains them, not how accurate it is):",
        _residuals("rotation", "deg", 180 / np.pi, r.rotation_rms, r.rotation_median, r.rotation_max),
        _residuals("translation", "mm", 1e3, r.translation_rms, r.translation_median, r.translation_max),
        "",
        f"{inverse_name} (inverse of X)",
        "",
        *_matrix(result.inverse),
    ]
    if result.W is not None:
        known = result.covariance_W
        turn = Rotation.from_matrix(result.W[:3, :3]).as_rotvec()
        of_turn, of_position = (None, None) if known is None else (known[:3, :3], known[3:, 3:])
        lines += [
            "",
            f"{result.frame_W} (the target, as all poses see it)",
            "",
            *_matrix(result.W),
            "",
            _row("translation (mm)", "xyz", 1e3 * result.W[:3, 3], _std(of_position, 1e3 * np.eye(3)), 4),
            _row("rotation vector (deg)", "xyz", np.degrees(turn), _std(of_turn, _rotvec_jacobian(turn)), 5),
        ]
    for section in (noise_lines, beside_lines, covariance_lines, pose_lines, budget_lines, diagnosis_lines):
        if text := section(result):
            lines += ["", *text]
    if result.std is not None:
        source = _SOURCES[result.covariance_kind]
        if result.noise_estimate is not None and result.covariance_kind == "model":
            source = "the noise estimated"
        limit = result.quantile(0.95)
        if np.isfinite(limit):
            lines += ["", f"95 % of all errors lie within d^2 = {limit:.1f} ({result.reference})."]
        else:
            lines += ["", f"There is no 95 % ellipsoid from so few poses ({result.reference})."]
        lines += ["", NOT_COVERED.format(source=source)]
    return "\n".join(lines) + "\n"


def against_truth(result: Calibration, truth: Array) -> str:
    """The error of X against a known one (4, 4), and whether it lies inside the ellipsoid."""
    turn = Rotation.from_matrix(result.X[:3, :3] @ truth[:3, :3].T).as_rotvec()
    xi = np.concatenate([turn, result.X[:3, 3] - truth[:3, 3]])
    lines = [
        f"Truth: X is off by {_digits(np.degrees(float(np.linalg.norm(turn))))} deg and "
        f"{_digits(1e3 * float(np.linalg.norm(xi[3:])))} mm."
    ]
    if result.covariance is not None:
        distance = float(xi @ np.linalg.solve(result.covariance, xi))
        limit = result.quantile(0.95)
        lines.append(
            f"Against the covariance: d^2 = {distance:.1f} with 6 degrees of freedom "
            f"({'inside' if distance <= limit else 'outside'} the 95 % ellipsoid, d^2 <= {limit:.1f})."
        )
    return "\n".join(lines) + "\n"


def _matrix(T: Array) -> list[str]:
    return ["  " + " ".join(f"{x + 0.0:13.9f}" for x in row) for row in np.where(np.abs(T) < 5e-10, 0.0, T)]


def _row(label: str, names: str, values: Array | None, std: Array | None, decimals: int) -> str:
    parts = []
    for k, name in enumerate(names):
        value = "" if values is None else f" {values[k] + 0.0:.{decimals}f}"
        deviation = "" if std is None else f" +- {_digits(std[k])}"
        parts.append(f"{name}{value}{deviation}")
    return f"{label:22s} " + "   ".join(parts)


def _residuals(name: str, unit: str, factor: float, *values: float) -> str:
    rms, median, largest = (_digits(factor * value) for value in values)
    return f"  {name:12s} RMS {rms} {unit}, median {median}, max {largest}"


def _digits(value: float) -> str:
    """Three significant digits without an exponent where that is short."""
    if value == 0 or 1e-4 <= abs(value) < 1e6:
        return f"{value:.3g}" if value == 0 or abs(value) < 100 else f"{value:.0f}"
    return f"{value:.2e}"


def _std(covariance: Array | None, J: Array) -> Array | None:
    return None if covariance is None else np.sqrt(np.clip(np.diag(J @ covariance @ J.T), 0.0, None))


def _rotvec_jacobian(rotvec: Array) -> Array:
    """Degrees of the rotation vector per rad of left rotation: ``J_l(rotvec)^-1``."""
    return np.asarray(np.degrees(np.linalg.inv(left_jacobian(rotvec))))


def _quaternion_jacobian(q: Array) -> Array:
    """``dq = (theta, 0) q / 2``, quaternions as (x, y, z, w): 4x3."""
    return 0.5 * np.vstack([q[3] * np.eye(3) - skew(q[:3]), -q[:3]])


def _correlations(result: Calibration, threshold: float) -> list[str]:
    correlation = result.correlation
    assert correlation is not None  # the caller asked for standard deviations first
    strong = [
        (abs(correlation[i, j]), f"  {NAMES[i]} with {NAMES[j]}: {correlation[i, j]:+.2f}")
        for i in range(6)
        for j in range(i + 1, 6)
        if abs(correlation[i, j]) >= threshold
    ]
    if not strong:
        return [f"Correlations: none reaches {threshold:g}.", ""]
    return [f"Correlations from {threshold:g} up:", *(text for _, text in sorted(strong, reverse=True)), ""]
