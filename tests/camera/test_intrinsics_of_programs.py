"""Intrinsics in the files of other programs, in pixels and coefficients of this one."""

import json

import numpy as np
import pytest

from uq_handeye.errors import InputError
from uq_handeye.model.camera.intrinsics_file import read_intrinsics
from uq_handeye.model.camera.known_intrinsics import KnownIntrinsics
from uq_handeye.model.camera.picture_region import for_pictures

K = [[910.0, 0, 645.0], [0, 912.0, 355.0], [0, 0, 1]]
D = [0.15, -0.45, 0.002, -0.0015, 0.4]
LINEAR = {"fx": 910.0, "fy": 912.0, "cx": 645.0, "cy": 355.0}
BROWN = LINEAR | dict(zip(("k1", "k2", "p1", "p2", "k3"), D, strict=True))
RATIONAL = (0.5, -2.6, 1.4, 0.38, -2.4, 1.3)  # k1 to k6
FIRST8 = dict(zip(("k1", "k2", "k3", "k4", "k5", "k6"), RATIONAL, strict=True))
TOML_TABLE = (
    '[cam_0]\nname = "left"\nsize = [1280, 720]\nmatrix = [[910.0, 0.0, 645.0], [0.0, 912.0, 355.0], [0.0, 0.0, 1.0]]\n'
    "distortions = [0.15, -0.45, 0.002, -0.0015, 0.4]\nrotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\n"
)
KALIBR = (
    "cam0:\n  camera_model: pinhole\n  distortion_model: radtan\n  intrinsics: [910.0, 912.0, 645.0, 355.0]\n"
    "  distortion_coeffs: [0.15, -0.45, 0.002, -0.0015]\n  resolution: [1280, 720]\n"
    "cam1:\n  camera_model: pinhole\n  distortion_model: equidistant\n  intrinsics: [910.0, 912.0, 645.0, 355.0]\n"
    "  distortion_coeffs: [0.1, 0.2, 0.3, 0.4]\n  resolution: [1280, 720]\n"
)
AZURE = {
    "CalibrationInformation": {
        "Cameras": [
            {
                "Intrinsics": {
                    "ModelParameterCount": 14,
                    "ModelParameters": [
                        *(645.5 / 1280, 475.5 / 960, 910 / 1280, 912 / 960),
                        *(*RATIONAL, 0.0, 0.0, -0.0015, 0.002),
                    ],
                    "ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
                },
                "Location": "CALIBRATION_CameraLocationPV0",
                "SensorWidth": 4096,
                "SensorHeight": 3072,
            }
        ]
    }
}
BIG = {"fx": 910.0, "fy": 912.0, "cx": 645.0, "cy": 355.0, "width": 1280, "height": 720}
VISION = {
    "cameras": [
        {
            "projection": {"type": "pinhole"},
            "distortion": {"type": "brown_conrady5", "k1": 0.15, "k2": -0.45, "k3": 0.4, "p1": 0.002, "p2": -0.0015},
            "sensor": {"type": "identity"},
            "intrinsics": {"type": "fx_fy_cx_cy_skew", **LINEAR, "skew": 0.0},
        }
    ]
}
FILES = {
    "realsense.json": (
        {"width": 1280, "height": 720, "ppx": 645.0, "ppy": 355.0, "fx": 910.0, "fy": 912.0}
        | {"model": "distortion.inverse_brown_conrady", "coeffs": D},
        "inverse_brown",
        BROWN,
    ),
    "lensboy.json": (
        {"type": "opencv", "lensboy-version": "4.0.3", "image_width": 1280, "image_height": 720, **LINEAR}
        | {"distortion_coeffs": D + [0.0] * 9},
        "brown",
        BROWN | {"k4": 0.0, "k5": 0.0, "k6": 0.0},
    ),
    "cic.json": (
        {"OpenCVModel5": BIG | {"k1": 0.15, "k2": -0.45, "p1": 0.002, "p2": -0.0015, "k3": 0.4}},
        "brown",
        BROWN,
    ),
    "depthai.json": (
        {"cameraData": [[2, {"intrinsicMatrix": K, "width": 1280, "height": 720, "cameraType": 0}
                         | {"distortionCoeff": D + [0.0] * 7 + [0.01, -0.02]}]]},
        "brown_full",
        BROWN | {"tau_x": 0.01, "tau_y": -0.02},
    ),
    "transforms.json": (
        {"fl_x": 910.0, "fl_y": 912.0, "cx": 645.5, "cy": 355.5, "w": 1280, "h": 720, "camera_model": "OPENCV"}
        | {"k1": 0.15, "k2": -0.45, "p1": 0.002, "p2": -0.0015, "frames": []},
        "brown",
        BROWN | {"k3": 0.0},
    ),
    "open3d.json": (
        {"width": 1280, "height": 720, "intrinsic_matrix": [910.0, 0, 0, 0, 912.0, 0, 645.0, 355.0, 1]},
        "pinhole",
        LINEAR,
    ),
    "multical.json": (
        {"cameras": {"a": {"model": "standard", "image_size": [1280, 720], "K": K, "dist": [D]}}, "camera_poses": {}},
        "brown",
        BROWN,
    ),
    "vision.json": (VISION, "brown", BROWN),
    "cameras.txt": ("# COLMAP\n1 OPENCV 1280 720 910 912 645.5 355.5 .15 -.45 .002 -.0015\n", "brown", {"k2": -0.45}),
    "aria.txt": (
        "1 RAD_TAN_THIN_PRISM_FISHEYE 1280 720 910 912 645.5 355.5 .1 .2 .3 .4 .5 .6 .01 .02 .001 .002 .003 .004\n",
        "fisheye624",
        LINEAR | {"k0": 0.1, "k5": 0.6, "p1": 0.02, "s3": 0.004},
    ),
    "calibration.toml": (TOML_TABLE, "brown", BROWN),
    "camchain.yaml:cam0": (KALIBR, "brown", LINEAR | {"k2": -0.45, "p2": -0.0015}),
    "camchain.yaml:cam1": (KALIBR, "fisheye", LINEAR | {"k4": 0.4}),
    "size.json": (LINEAR | {"image_size": {"width": 1280, "height": 720}}, None, LINEAR),
    "opencv.yaml": (
        f"image_width: 1280\nimage_height: 720\ncamera_matrix: {K}\ndistortion_coefficients: {D}\n"
        f"stdDeviationsIntrinsics: {[1.0, 1.1, 0.5, 0.6, 0.01, 0.02, 0.001, 0.002, 0.03] + [0.0] * 9}\n",
        "brown",
        {"fx": (910.0, 1.0), "cy": (355.0, 0.6), "p2": (-0.0015, 0.002), "k3": (0.4, 0.03)},
    ),
    "aspect.yaml": (  # CALIB_FIX_ASPECT_RATIO
        f"image_width: 1280\nimage_height: 720\ncamera_matrix: {K}\ndistortion_coefficients: {D}\n"
        f"stdDeviationsIntrinsics: {[0.0, 1.14, 0.0, 0.0, 0.01, 0.02, 0.001, 0.002, 0.03]}\n",
        "brown",
        {"fx": (910.0, 1.1375), "fy": (912.0, 1.14), "cx": 645.0},
    ),
}  # fmt: skip


def written(folder, name, content):
    path = folder / name.partition(":")[0]
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return folder / name


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_each_program(name, tmp_path):
    content, model, values = FILES[name]
    known = read_intrinsics(written(tmp_path, name, content))
    assert known.model == model
    assert known.image_size == (None if name == "vision.json" else (1280, 720))
    for key, value in values.items():
        assert known.values[key] == pytest.approx(value, abs=1e-12), key


def test_azure_kinect_in_each_mode(tmp_path):
    known = read_intrinsics(written(tmp_path, "azure.json", AZURE))
    wide = for_pictures(known, (1280, 720), None, "azure.json")
    assert wide.model == "brown" and wide.values == pytest.approx(
        LINEAR | FIRST8 | {"p1": 0.002, "p2": -0.0015}, abs=1e-9
    )
    whole = for_pictures(known, (1280, 960), None, "azure.json")
    assert whole.values["cy"] == pytest.approx(475.0)
    assert "rows cut from 4:3" in wide.how and "scaled" in whole.how


def test_camera_info_with_roi_and_binning(tmp_path):
    text = (
        f"header: {{frame_id: cam}}\nheight: 720\nwidth: 1280\ndistortion_model: plumb_bob\nd: {D}\n"
        f"k: {np.ravel(K).tolist()}\nbinning_x: 2\nbinning_y: 2\n"
        "roi: {x_offset: 100, y_offset: 40, height: 600, width: 1000, do_rectify: false}\n"
    )
    known = read_intrinsics(written(tmp_path, "info.txt", text))
    assert known.image_size == (500, 300) and "roi 1000 x 600 from (100, 40), binning 2 x 2" in known.how
    expected = {"fx": 455.0, "fy": 456.0, "cx": 0.5 * (545.0 + 0.5) - 0.5, "cy": 0.5 * (315.0 + 0.5) - 0.5}
    assert {key: known.values[key] for key in expected} == pytest.approx(expected)
    assert known.values["k2"] == -0.45


def test_another_size_is_scaled_or_refused():
    known = KnownIntrinsics(
        {"fx": (900.0, 2.0), "fy": 900.0, "cx": 639.5, "cy": 479.5, "k1": 0.1}, "brown", (1280, 960)
    )
    half = for_pictures(known, (640, 480), None, "f.json")
    assert half.values == {"fx": (450.0, 1.0), "fy": 450.0, "cx": 319.5, "cy": 239.5, "k1": 0.1}
    with pytest.raises(InputError, match=r"another aspect: a part of them\. Add --roi"):
        for_pictures(known, (1280, 720), None, "f.json")
    cut = for_pictures(known, (1280, 720), (0, 120, 1280, 720), "f.json")
    assert cut.values["cy"] == 359.5 and cut.values["cx"] == 639.5
    with pytest.raises(InputError, match="beyond the 1280 x 960 pixels"):
        for_pictures(known, None, (100, 0, 1280, 720), "f.json")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("camchain.yaml", KALIBR, "several cameras: name one behind a colon"),
        ("camchain.yaml:cam7", KALIBR, "no camera 'cam7'"),
        ("c.yaml", KALIBR.partition("cam1")[0].replace("pinhole", "omni"), "camera model 'omni' of Kalibr"),
        ("u.json", {"EUCM": BIG}, "camera model 'EUCM' is not one"),
        ("s.json", FILES["lensboy.json"][0] | {"type": "pinhole_splined"}, "camera model 'pinhole_splined'"),
        (
            "four.yaml",
            f"camera_matrix: {K}\ndistortion_coefficients: [0.1, 0.2, 0.01, 0.02]\n",
            "--model brown or --model",
        ),
        ("r.json", FILES["realsense.json"][0] | {"model": "distortion.ftheta"}, "camera model 'distortion.ftheta'"),
        ("cameras.txt", "1 FOV 1280 720 910 912 645 355 0.1\n", "camera model FOV of COLMAP"),
        ("cut.json", {"ppx": 1.0, "ppy": 2.0, "fx": 3.0}, "fy"),
    ],
)
def test_what_is_not_known_is_refused_by_name(name, content, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read_intrinsics(written(tmp_path, name, content))
