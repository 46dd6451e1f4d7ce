"""Evidence that a calibration takes in: equal to the fit of all, stored, and used once."""

import numpy as np
import pytest
from fixtures.commands import run
from fixtures.rigs import quietly
from fixtures.touches import NOISE, TIP, TRUTH, calibration, touches
from support import SEED

import uq_handeye as uq
from uq_handeye.calibration.evidence.new_poses import evidence_of_poses
from uq_handeye.core.geometry.se3 import logarithm
from uq_handeye.findings import Finding
from uq_handeye.use.maintenance.update import absorbed_into


def whitened(result, X):
    """Difference of X in standard deviations."""
    turn = logarithm(result.X[:3, :3] @ X[:3, :3].T)
    return np.concatenate([turn, result.X[:3, 3] - X[:3, 3]]) / result.std


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_poses_taken_in_are_the_fit_of_all(setup):
    """A shared error, whose estimate moves with X and W."""
    data = uq.simulate(24, setup=setup, noise=NOISE, seed=2)
    options = {"noise": NOISE, "shared": [uq.SharedError.target_scale(0.003)], "robust": False, "method": "ml"}
    first, both = quietly(data.rows(range(16)), **options), quietly(data, **options)
    used = Finding("evidence.touches_used", "note", {"count": 0})
    found = absorbed_into(first, evidence_of_poses(first, data.rows(range(16, 24))), used, {"more": 8})
    assert np.abs(whitened(found, both.X)).max() < 0.01 < np.abs(whitened(first, both.X)).max()
    np.testing.assert_allclose(found.std, both.std, rtol=0.005)
    mine, of_all, before = (one.shared[0] for one in (found, both, first))
    assert mine.estimate == pytest.approx(of_all.estimate, abs=0.02 * of_all.sd)
    assert mine.sd == pytest.approx(of_all.sd, rel=0.01) and before.sd > 1.1 * mine.sd
    assert found.provenance.options["more"] == 8 and found.posterior.estimate[0] == mine.estimate


@pytest.mark.slow
@pytest.mark.parametrize("tool_sd", [0.0, 3e-4, np.inf])
def test_touches_make_x_better_and_truthful(tool_sd):
    """NEES of X over calibrations of their own, near 6."""
    rng, nees, better = np.random.default_rng(SEED), [], []
    for _ in range(12):
        before = calibration("eye-to-hand", rng)
        error = rng.normal(size=3) * (2e-3 if np.isinf(tool_sd) else tool_sd)
        case = touches("eye-to-hand", rng, tool=TIP, tool_sd=tool_sd, tool_error=error)
        found = uq.include_touches(before, case)
        xi = whitened(found, TRUTH["eye-to-hand"].truth.X) * found.std
        nees.append(xi @ np.linalg.solve(found.covariance, xi))
        better.append(found.std / before.std)
    assert abs(np.mean(nees) - 6) < 4 * np.sqrt(12 / len(nees))
    assert np.max(better) < 1 and np.mean(better) < 0.95


def test_a_result_with_touches_is_stored_and_takes_them_once(tmp_path):
    rng = np.random.default_rng(SEED)
    case = touches("eye-in-hand", rng)
    found = uq.include_touches(calibration("eye-in-hand", rng), case)
    again = uq.Calibration.from_dict(found.to_dict())
    np.testing.assert_array_equal(again.X, found.X)
    assert again.headline == found.headline and "8 touched points" in found.accuracy.included
    assert "8 touched points are part of the result and agree" in str(again.findings[-1])
    one = Finding("evidence.touches_used", "note", {"count": 1, "d2": 1.0, "dof": 3, "p_value": 0.8, "rms": 1e-3})
    assert "1 touched point is part of the result and agrees" in str(one)
    with pytest.raises(uq.InputError, match="a touch counts once"):
        uq.include_touches(again, case)
    with pytest.raises(uq.InputError, match="Verify with others"):
        uq.verify(again, case)
    wrong = type(case)(**(vars(case) | {"touched": case.touched + 0.01}))
    contradicted = uq.include_touches(calibration("eye-in-hand", rng), wrong)
    assert any("8 touched points" in text and "contradict" in text for text in contradicted.warnings)
    with pytest.raises(uq.InputError, match="covariance of its noise model"):
        uq.include_touches(quietly(found.data, noise=NOISE, shared=[], covariance="sandwich"), case)


@pytest.mark.slow
def test_the_command_takes_touches_in(tmp_path):
    from uq_handeye.read import write_pose_file

    data = uq.simulate(12, setup="eye-to-hand", noise=NOISE, seed=2)
    for name, T in (("robot", data.robot), ("camera", data.camera)):
        write_pose_file(tmp_path / f"{name}.csv", T)
    X = data.truth.X
    seen = np.random.default_rng(SEED).uniform([-0.1, -0.1, 0.4], [0.1, 0.1, 0.7], (6, 3))
    rows = np.hstack([seen, seen @ X[:3, :3].T + X[:3, 3]]).tolist()
    head = ",".join([*(f"seen_{a}" for a in "xyz"), *(f"touched_{a}" for a in "xyz")])
    (tmp_path / "touches.csv").write_text("\n".join([head, *(",".join(map(repr, row)) for row in rows)]) + "\n")
    plain = ("calibrate", tmp_path / "robot.csv", tmp_path / "camera.csv", "--setup", "eye-to-hand")
    noise = ("--robot-noise", "0.02deg,0.05mm", "--camera-noise", "0.1deg,0.5mm")
    done = run(*plain, *noise, "--touches", tmp_path / "touches.csv", "--tcp-sd", "0.2mm")
    assert done.returncode == 0 and "6 touched points are part of the result" in " ".join(done.stdout.split())
    alone = run(*plain, *noise, "--tcp-sd", "0.2mm")
    assert alone.returncode == 2 and "need --touches FILE.csv" in alone.stderr
