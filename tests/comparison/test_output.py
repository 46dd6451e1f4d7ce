"""A comparison as text, JSON, CSV: every number as `calibrate` gives it, in the unit that its name says."""

import dataclasses
import io
import json
import math
import re

import numpy as np
import pandas as pd
import pytest
from fixtures.comparisons import compare
from fixtures.pages import DOCS
from support import difference, moved

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.report.comparison import compare as module
from uq_handeye.report.comparison.compare import Row, against
from uq_handeye.report.comparison.result import apart, digits

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
FEW = ("tsai", "park", "gwak", "4dpa")


@pytest.fixture(scope="module")
def poses():
    return uq.simulate(12, noise=NOISE, seed=5)


@pytest.fixture(scope="module")
def everything(poses):
    return compare(poses, noise=NOISE)


def no_constant(name):
    raise AssertionError(f"{name} in JSON")


@pytest.mark.slow
def test_json(everything, tmp_path):
    text = everything.to_json(tmp_path / "comparison.json")
    assert (tmp_path / "comparison.json").read_text() == text
    data = json.loads(text, parse_constant=no_constant)
    assert data == everything.to_dict()
    assert [entry["method"] for entry in data["methods"]] == list(uq.METHODS)
    for entry, row in zip(data["methods"], everything.rows, strict=True):
        if row.X is not None:
            np.testing.assert_array_equal(entry["X"], row.X)  # no digit is lost
            np.testing.assert_array_equal(entry["covariance"], row.covariance)
            assert (entry["d2"], entry["agrees"]) == (row.d2, row.agrees)
    with pytest.raises(InputError, match="no folder"):
        everything.to_json(tmp_path / "no" / "comparison.json")


def test_infinite_distance_is_no_number_in_json(poses, monkeypatch):
    original = module.calibrate

    def calibrate(data, *, method=None, **options):
        found = original(data, method=method, **options)
        return dataclasses.replace(found, covariance=np.zeros((6, 6))) if method == "park" else found

    monkeypatch.setattr(module, "calibrate", calibrate)
    result = compare(poses, noise=NOISE, methods=FEW)
    assert result["park"].d2 == math.inf and result["park"].agrees is False
    entry = json.loads(result.to_json(), parse_constant=no_constant)["methods"][1]
    assert (entry["d2"], entry["agrees"]) == (None, False)
    assert "inf" in result.to_text(verbose=True)


def test_csv(everything, tmp_path):
    text = everything.to_csv(tmp_path / "comparison.csv")
    assert (tmp_path / "comparison.csv").read_text() == text
    assert "nan" not in text.lower()
    table = pd.read_csv(io.StringIO(text), dtype={"method": str}).set_index("method")
    assert list(table.index) == list(uq.METHODS)
    assert table["is_reference"].sum() == 1
    for row in everything.rows:
        if row.X is None:
            assert isinstance(table.loc[row.method, "failure"], str)
            continue
        entry = table.loc[row.method]
        X = [[entry[f"X_{i}{j}" + ("_m" if j == 4 else "")] for j in range(1, 5)] for i in range(1, 4)]
        np.testing.assert_allclose(np.array(X, dtype=float), row.X[:3], rtol=0, atol=1e-15)
        assert entry["translation_y_mm"] == pytest.approx(1e3 * row.X[1, 3])
        assert entry["std_theta_z_deg"] == pytest.approx(math.degrees(row.std[2]))
        assert entry["difference_rotation_deg"] == pytest.approx(math.degrees(row.difference_rotation))
        assert entry["error_62"] == pytest.approx(row.residuals.error)
        assert entry["time_ms"] == pytest.approx(1e3 * row.seconds)


def test_text_is_plain_and_narrow(everything):
    text = everything.to_text(verbose=True)
    assert text == everything.to_text(verbose=True)
    assert text.isascii() and "\x1b" not in text
    assert max(map(len, text.splitlines())) <= 120
    assert not any(line != line.rstrip() for line in text.splitlines())
    for name in uq.METHODS:
        assert sum(line.startswith(f"{name} ") for line in text.splitlines()) >= 1
    for phrase in ("may be wrong together", "not how accurate", "error (62)", "+- 1 sigma"):
        assert phrase in " ".join(text.split())


def test_text_stays_narrow_with_large_numbers(everything):
    huge = np.array([2.0, -1.0, 1.5, -123456.789, 98765.4321, -4e7])
    rows = [everything["4dpa"]]
    for row in everything.rows:
        if row.X is not None and row.method != "4dpa":
            wild = dataclasses.replace(row, X=moved(row.X, huge), seconds=1234.5, iterations=10000)
            wild = dataclasses.replace(wild, residuals=row.residuals._replace(error=123456.789, rotation_rms=3.1))
            rows.append(against(wild, rows[0]))
    text = dataclasses.replace(everything, rows=tuple(rows)).to_text(verbose=True)
    assert max(map(len, text.splitlines())) <= 120


def test_digits():
    assert [digits(x) for x in (None, 0.0, 1.23456, 12.3456, 123.456, 1234.56, 0.00123456)] == [
        *("-", "0", "1.23", "12.3", "123", "1235"),
        "0.00123",
    ]
    assert [digits(x) for x in (1e-9, 1e7, 9.999, -0.5, math.inf)] == ["1.0e-09", "1.0e+07", "10.0", "-0.500", "inf"]
    assert digits(2.0, 1e3) == "2000"


def test_rotation_vectors_near_half_a_turn_share_a_branch(poses):
    rotvec = np.array([0, np.pi - 1e-3, 0])
    base = Row("4dpa", 2019, "", "", X=moved(np.eye(4), np.array([*rotvec, 0, 0, 0])), converged=True)
    beyond = dataclasses.replace(base, method="park", X=moved(base.X, np.array([0, 2e-3, 0, 0, 0, 0])))
    rows = tuple(against(row, base) for row in (base, beyond))
    result = dataclasses.replace(compare(poses, methods=["park"]), rows=rows)
    table = result.to_dataframe().set_index("method")
    assert table.loc["4dpa", "rotation_vector_y_deg"] == pytest.approx(180 - math.degrees(1e-3), abs=1e-9)
    assert table.loc["park", "rotation_vector_y_deg"] == pytest.approx(180 + math.degrees(1e-3), abs=1e-9)
    assert "180.057" in result.to_text(verbose=True) and "-179.9" not in result.to_text(verbose=True)
    assert "longer than 180 degrees" in result.to_text(verbose=True)
    assert "longer than 180 degrees" not in dataclasses.replace(result, rows=rows[:1]).to_text(verbose=True)


def test_rounding_is_no_difference(poses):
    tiny = np.array([1e-13, 0, 0, 0, 1e-14, 0])
    base = Row("4dpa", 2019, "", "", X=np.eye(4), covariance=np.zeros((6, 6)), converged=True)
    row = against(dataclasses.replace(base, method="park", X=moved(base.X, tiny)), base)
    assert (row.d2, row.agrees) == (0, True)
    text = dataclasses.replace(compare(poses, methods=["park"]), rows=(base, row), noise=NOISE).to_text(verbose=True)
    assert re.search(r"\npark +<1e-9 +<1e-9 +0  agrees", text)
    assert [apart(x) for x in (0.0, 9e-10, 2e-9, None)] == ["0", "<1e-9", "2.0e-09", "-"]


def printed(text):
    """The two tables: numbers of each method, and its X with standard deviations as [[value, sigma], ...]."""
    first, second = text.split("rotation vector of X")
    numbers = {
        line.split()[0]: line.split()[1:] for line in first.splitlines() if line[:1].islower() or line[:1] == "4"
    }
    poses = {}
    for line in second.splitlines():
        if line.count("+-") == 6:
            name, *cells = re.split(r" +(?:\+-)?", line)
            poses[name] = np.array(cells, dtype=float).reshape(6, 2)
    return numbers, poses


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.0, 1.5])
def test_printed_numbers_are_those_of_calibrate(turn):
    """Every number of text and CSV against the `Calibration` of the same method, in the units of the headings."""
    poses = uq.simulate(12, noise=NOISE, seed=5)
    base = moved(np.eye(4), np.array([turn, 0.3 * turn, -0.2 * turn, 0, 0, 0]))  # another gripper frame, another X
    poses = dataclasses.replace(poses, robot=poses.robot @ base, truth=None)
    result = compare(poses, noise=NOISE, methods=FEW)
    numbers, shown = printed(result.to_text(verbose=True))
    table = pd.read_csv(io.StringIO(result.to_csv())).set_index("method")
    reference = uq.calibrate(poses, noise=NOISE, method="4dpa")
    for name in FEW:
        found = uq.calibrate(uq.relative_motions(poses, "all"), noise=NOISE, method=name)
        vector = np.array([table.loc[name, f"rotation_vector_{a}_deg"] for a in "xyz"])
        std = np.array([table.loc[name, f"std_theta_{a}_deg"] for a in "xyz"])
        std_tau = np.array([table.loc[name, f"std_tau_{a}_mm"] for a in "xyz"])
        np.testing.assert_allclose(std, np.degrees(found.std[:3]), rtol=1e-4)
        np.testing.assert_allclose(std_tau, 1e3 * found.std[3:], rtol=1e-4)
        # the rotation vector, and the standard deviation of it by central differences
        values, sigma = shown[name].T
        J = np.empty((3, 3))
        for k in range(3):
            plus, minus = (rotvec(moved(found.X, s * 1e-6 * np.eye(6)[k]), vector) for s in (1, -1))
            J[:, k] = (plus - minus) / 2e-6
        expected = np.degrees(np.sqrt(np.diag(J @ found.covariance[:3, :3] @ J.T)))
        np.testing.assert_allclose(sigma[:3], expected, rtol=0.006)
        np.testing.assert_allclose(sigma[3:], 1e3 * found.std[3:], rtol=0.006)
        np.testing.assert_allclose(values[:3], vector, atol=6e-4)
        np.testing.assert_allclose(vector, np.degrees(rotvec(found.X, vector)), atol=1e-7)
        np.testing.assert_allclose(values[3:], 1e3 * found.X[:3, 3], atol=6e-4)
        # the row: difference, weakest directions, residuals
        row = numbers[name]
        rotation, translation = (float(np.linalg.norm(part)) for part in np.split(difference(found.X, reference.X), 2))
        weakest = np.degrees(found.weakest_rotation[1]), 1e3 * found.weakest_translation[1]
        residuals = np.degrees(found.residuals.rotation_rms), 1e3 * found.residuals.translation_rms
        np.testing.assert_allclose([float(x) for x in row[4:6]], weakest, rtol=0.006)
        np.testing.assert_allclose([float(x) for x in row[6:8]], residuals, rtol=0.006)
        assert float(row[8]) == pytest.approx(1e3 * found.residuals.error, rel=0.006)
        if name != "4dpa":
            differences = [math.degrees(rotation), 1e3 * translation]
            np.testing.assert_allclose([float(x) for x in row[:2]], differences, rtol=0.006)
            columns = ["difference_rotation_deg", "difference_translation_mm"]
            np.testing.assert_allclose(table.loc[name, columns].astype(float), differences, rtol=1e-4)
        np.testing.assert_allclose(table.loc[name, "residual_rotation_rms_deg"], residuals[0], rtol=1e-5)
        np.testing.assert_allclose(table.loc[name, "residual_translation_rms_mm"], residuals[1], rtol=1e-5)


def rotvec(X, near):
    """Rotation vector (rad) of X by its own formula, on the branch of ``near`` (deg)."""
    R = X[:3, :3]
    axis = np.linalg.svd(R - np.eye(3))[2][-1]
    axis = axis * np.sign(axis @ near)
    skewed = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return axis * (math.atan2(axis @ skewed, np.trace(R) - 1) % (2 * math.pi))


def test_sigma_keeps_two_digits(everything):
    rows = []
    for k, row in enumerate(row for row in everything.rows if row.X is not None):
        rows.append(dataclasses.replace(row, covariance=row.covariance * 10.0 ** (4 - k)))
    text = dataclasses.replace(everything, rows=tuple(rows)).to_text(verbose=True)
    sigmas = re.findall(r"\+-(\S+)", text.split("rotation vector of X")[1])
    assert len(sigmas) == 6 * len(rows)
    for sigma in sigmas:
        assert len(re.sub(r"e.*|\.", "", sigma).lstrip("0")) >= 2 and len(sigma) <= 6, sigma


def test_the_page_documents_every_field(everything):
    page = (DOCS / "reference" / "compare.md").read_text()
    sections = {title: page.split(f"\n## {title}\n")[1].split("\n## ")[0] for title in ("JSON", "CSV")}

    def documented(title):
        cells = [line.split("|")[1] for line in sections[title].splitlines() if line.startswith("|")]
        return [name for cell in cells for name in re.findall(r"`(\w+)`", cell)]

    data = everything.to_dict()
    assert sorted(documented("JSON")) == sorted([*data, *data["methods"][0]])
    assert documented("CSV") == list(everything.to_dataframe().columns)
    for name in everything["park"].residuals._fields:
        assert f"`{name}`" in sections["JSON"]
    assert data["version"] == uq.__version__
    assert data["noise"] == uq.calibrate(uq.simulate(5, seed=1), noise=NOISE).to_dict()["noise"]
