"""Files of vendors and tools as they come, read beside a camera file without a word about their format."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.read import read_poses, write_pose_file

PAIRS = uq.simulate(n_poses=8, seed=3)
G = np.asarray(PAIRS.robot)
T, R = G[:, :3, 3], Rotation.from_matrix(G[:, :3, :3])
Q, XYZ, ROTVEC = R.as_quat(), R.as_euler("xyz", degrees=True), R.as_rotvec()
W_FIRST = Q[:, [3, 0, 1, 2]]


def lines(head, *columns, mark=",", row="{}"):
    table = np.column_stack(columns)
    return "\n".join([*head, *(row.format(mark.join(f"{x:.9f}" for x in values)) for values in table)])


FILES = {
    "kinova.json": json.dumps(
        [dict(zip([f"toolPose{a}" for a in "XYZ"] + [f"toolPoseTheta{a}" for a in "XYZ"], row, strict=True))
         for row in np.hstack([T, XYZ]).tolist()]
    ),
    "ur.jsonl": "\n".join(
        json.dumps({"actual_TCP_pose": row, "actual_q": [1, 2, 3, 4, 5, 6]}) for row in np.hstack([T, ROTVEC]).tolist()
    ),
    "denso.txt": lines([], 1e3 * T, XYZ, row="P1 = P({}, 5)"),
    "colmap.txt": lines(
        ["# Image list with two lines of data per image:", "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"],
        np.arange(8), W_FIRST, T, mark=" ", row="{} 1 a.png\n100.5 200.25 -1 340.5 222.1 17",
    ),
    **{f"motive_{one}.csv": lines(
        ["Format Version,1.23,Take Name,Take1,Rotation Type,Quaternion", ",Name" + ",Tool" * 7, ",ID" + f",{one}" * 7,
         ",," + ",".join(["Rotation"] * 4 + ["Position"] * 3), "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z"],
        np.arange(8), 0.1 * np.arange(8), Q, T,
    ) for one in ("1", "8A41F2")},
    "ndi.csv": lines(["Frame,Q0,Qx,Qy,Qz,Tx,Ty,Tz,Error"], np.arange(8), W_FIRST, 1e3 * T, np.full(8, 0.1)),
    "names.csv": lines(["pos_x,pos_y,pos_z,ori_x,ori_y,ori_z,ori_w"], T, Q),
    "excel.txt": lines(["x\ty\tz\tqx\tqy\tqz\tqw"], T, Q, mark="\t").replace(".", ",").encode("utf-16"),
    "latin.csv": lines(["Gr\u00f6\u00dfe;x;y;z;qx;qy;qz;qw"], T, Q, mark=";", row="\u00e4;{}").encode("latin-1"),
    "minus.csv": lines(["x,y,z,qx,qy,qz,qw"], T, Q).replace("-", "\u2212"),
    "urdf.xml": "\n".join(
        f'<origin xyz="{" ".join(map(repr, t))}" rpy="{" ".join(map(repr, a))}"/>'
        for t, a in zip(T.tolist(), np.radians(XYZ).tolist(), strict=True)
    ),
    "thousands.csv": "\n".join(
        ["x,y,z,rx,ry,rz", *(",".join([*(f'"{1e4 * x:,.6f}"' for x in t), *map(repr, a)])
                             for t, a in zip(T.tolist(), ROTVEC.tolist(), strict=True))]
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_files_of_vendors_and_tools(tmp_path, name):
    content = FILES[name]
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    write_pose_file(tmp_path / "camera.csv", PAIRS.camera, 0.1 * np.arange(8))
    poses = read_poses(tmp_path / name, tmp_path / "camera.csv", pair="rows")
    assert name != "motive_1.csv" or np.allclose(poses.timestamps, 0.1 * np.arange(8))
    found = np.array(poses.robot)
    found[:, :3, 3] /= 10.0 if name == "thousands.csv" else 1.0
    assert np.allclose(found, G, atol=1e-6)


@pytest.mark.parametrize(("head", "row"), [("x,y,z,qx,qy,qz,qw", "0,0,0,0,0,0,1"), ("x;y;z;a;b;c", "1;2;3;4;5;6")])
@pytest.mark.parametrize("mark", ["#NV", "#N/A", "#DIV/0!", "#VALUE!"])
def test_a_row_without_values_is_no_comment(tmp_path, head, row, mark):
    """The marks of spreadsheets begin with #; left out, the rows behind them would have wrong partners."""
    separator = "," if "," in head else ";"
    path = tmp_path / "robot.csv"
    path.write_text("\n".join([head, row, separator.join([mark] * row.count(separator)) + f"{separator}{mark}", row]))
    with pytest.raises(uq.InputError, match=f"line 3, column x: expected a number, got '{mark}'"):
        read_poses(path, path)
