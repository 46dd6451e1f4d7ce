"""Poses as the controllers write them, made without the code under test: products of rotations about x, y and z."""

import numpy as np

N = 30


def axis_rotation(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    R = np.eye(3)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = -s, s
    return R


def rz_ry_rx(z, y, x):
    return axis_rotation(2, z) @ axis_rotation(1, y) @ axis_rotation(0, x)


def rx_ry_rz(x, y, z):
    return axis_rotation(0, x) @ axis_rotation(1, y) @ axis_rotation(2, z)


def rz_ry_rz(o, a, t):
    return axis_rotation(2, o) @ axis_rotation(1, a) @ axis_rotation(2, t)


def rodrigues(v):
    angle = np.linalg.norm(v)
    k = np.array(v) / angle
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def quaternion_rotation(w, x, y, z):
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


# Each convention: the numbers as they are drawn, and the rotation that they are, as the maker's manual says it.
def _degrees(product):
    return lambda numbers: product(*np.radians(numbers))


CONVENTIONS = {
    "ur": ("rotvec", rodrigues),
    "kuka": ("deg", _degrees(rz_ry_rx)),  # Rz(A) Ry(B) Rx(C)
    "fanuc": ("deg", _degrees(lambda w, p, r: rz_ry_rx(r, p, w))),
    "abb": ("quaternion", lambda q: quaternion_rotation(*q)),
    "staubli": ("deg", _degrees(rx_ry_rz)),
    "yaskawa": ("deg", _degrees(lambda x, y, z: rz_ry_rx(z, y, x))),
    "kawasaki": ("deg", _degrees(rz_ry_rz)),
    "mitsubishi": ("deg", _degrees(lambda a, b, c: rz_ry_rx(c, b, a))),
    "denso": ("deg", _degrees(lambda x, y, z: rz_ry_rx(z, y, x))),
    "epson": ("deg", _degrees(rz_ry_rx)),  # U about Z, V about Y, W about X
    "doosan": ("deg", _degrees(rz_ry_rz)),
    "comau": ("deg", _degrees(rz_ry_rz)),
    "techman": ("deg", _degrees(lambda x, y, z: rz_ry_rx(z, y, x))),
    "dobot": ("deg", _degrees(lambda x, y, z: rz_ry_rx(z, y, x))),
    "jaka": ("deg", _degrees(lambda x, y, z: rz_ry_rx(z, y, x))),
    "xarm": ("deg", _degrees(lambda r, p, y: rz_ry_rx(y, p, r))),
    "rpy": ("rad", lambda a: rz_ry_rx(a[2], a[1], a[0])),
}
METRES = ("ur", "rpy")
RXYZ = "x,y,z,rx,ry,rz"
QUOTED = '{}="{}"'
NAMES = {
    "kuka": "X,Y,Z,A,B,C",
    "fanuc": "X,Y,Z,W,P,R",
    "abb": "x,y,z,q1,q2,q3,q4",
    "kawasaki": "X,Y,Z,O,A,T",
    "rpy": "x,y,z,roll,pitch,yaw",
    "epson": "X,Y,Z,U,V,W",
    "comau": "X,Y,Z,A,E,R",
    "mitsubishi": "X,Y,Z,A,B,C",
    "doosan": "X,Y,Z,A,B,C",
    "xarm": "x,y,z,roll,pitch,yaw",
}


def drawn(maker, rng, n=N):
    """Return the numbers (n, 6 or 7) of random poses in the maker's units, and the poses (n, 4, 4) in metres."""
    kind, rotation = CONVENTIONS[maker]
    position = rng.uniform([0.2, -0.5, 0.1], [0.8, 0.5, 0.9], (n, 3))
    if kind == "deg":
        numbers = rng.uniform([-180, -85, -180], [180, 85, 180], (n, 3))
        # Near half turns, and at gimbal lock.
        numbers[:4] = [[179.9999, 10, -179.9999], [180, 0, 180], [20, 90, 30], [-180, -90, 0.5]]
    elif kind == "rad":
        numbers = rng.uniform([-np.pi, -1.5, -np.pi], [np.pi, 1.5, np.pi], (n, 3))
        numbers[:2] = [[np.pi, 0.1, -np.pi], [0.3, np.pi / 2, 0.2]]
    elif kind == "rotvec":
        v = rng.normal(size=(n, 3))
        numbers = v / np.linalg.norm(v, axis=1)[:, None] * rng.uniform(0.1, np.pi - 1e-6, (n, 1))
        numbers[0] *= (np.pi - 1e-9) / np.linalg.norm(numbers[0])
    else:
        q = rng.normal(size=(n, 4))
        numbers = q / np.linalg.norm(q, axis=1)[:, None]
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = [rotation(row) for row in numbers]
    T[:, :3, 3] = position
    return np.hstack([position * (1 if maker in METRES else 1000), numbers]), T


def csv(numbers, names=None, sep=",", end="\n"):
    rows = [sep.join(map(repr, row)) for row in numbers.tolist()]
    return end.join(([] if names is None else [names.replace(",", sep)]) + rows) + end


def braces(row, names, form="{} {}", sep=","):
    return sep.join(form.format(name, repr(value)) for name, value in zip(names, row, strict=True))


def program(maker, numbers):
    """Return the maker's own program or data file with these poses."""
    rows = numbers.tolist()
    lines = [[repr(value) for value in row] for row in rows]
    if maker == "ur":
        moves = [f"  pose_{k} = p[{', '.join(row)}]" for k, row in enumerate(lines)]
        joints = "  movej([0.1, -1.5, 1.2, 0.3, 0.2, 0.1], a=1.4, v=1.05)"
        return "\n".join(["def calibration():", "  set_tcp(p[0,0,0.1,0,0,0])", joints, *moves, "end", ""])
    if maker == "kuka":
        head = "&ACCESS RVP\r\n&REL 1\r\nDEFDAT CALIB PUBLIC\r\n;FOLD EXTERNAL {X 1,Y 2,Z 3,A 4,B 5,C 6}\r\n"
        tool = "DECL FRAME TOOL_DATA1={X 1.0,Y 2.0,Z 3.0,A 4.0,B 5.0,C 6.0}\r\n"
        poses = [
            f"DECL E6POS XP{k + 1}={{{braces(row, 'XYZABC')},S 6,T 27,E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}}\r\n"
            f'DECL FDAT FP{k + 1}={{TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}}\r\n'
            for k, row in enumerate(rows)
        ]
        return head + tool + "".join(poses) + "ENDDAT\r\n"
    if maker == "fanuc":
        head = "/PROG  CALIB\n/ATTR\nOWNER = MNEDITOR;\n/MN\n   1:  !a comment P[1]{ ;\n   2:J P[1] 100% FINE ;\n/POS\n"
        poses = [
            f"P[{k + 1}{':' + chr(34) + 'see' + chr(34) if k == 2 else ''}]{{\n   GP1:\n"
            f"\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n"
            f"\tX = {row[0]}  mm,\tY = {row[1]}  mm,\tZ = {row[2]}  mm,\n"
            f"\tW = {row[3]} deg,\tP = {row[4]} deg,\tR = {row[5]} deg\n}};\n"
            for k, row in enumerate(lines)
        ]
        return head + "".join(poses) + "/END\n"
    if maker == "abb":
        head = "MODULE Calib\n  ! robtarget old:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
        tool = "  PERS tooldata tGrip:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
        poses = [
            f"  CONST robtarget p{10 * k}:=[[{','.join(row[:3])}],[{','.join(row[3:])}],[0,-1,0,1],"
            "[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];\n"
            for k, row in enumerate(lines)
        ]
        return head + tool + "".join(poses) + "ENDMODULE\n"
    if maker == "staubli":
        head = (
            '<?xml version="1.0" encoding="utf-8" ?>\n<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
        )
        head += 'xmlns="http://www.staubli.com/robotics/VAL3/Data/2">\n  <Datas>\n'
        tool = '    <Data name="tCam" access="public" xsi:type="array" type="tool" size="1">\n      <Value key="0" '
        tool += 'x="1" y="2" z="3" rx="4" ry="5" rz="6" fatherId="flange[0]" />\n    </Data>\n'
        poses = [
            f'      <Value key="{k}" {braces(row, RXYZ.split(","), QUOTED, " ")}'
            ' shoulder="lefty" elbow="epositive" wrist="wpositive" fatherId="world[0]" />\n'
            for k, row in enumerate(rows)
        ]
        data = f'    <Data name="pCal" access="public" xsi:type="array" type="pointRx" size="{len(rows)}">\n'
        return head + tool + data + "".join(poses) + "    </Data>\n  </Datas>\n</Database>\n"
    if maker == "yaskawa":
        head = f"/JOB\r\n//NAME CALIB\r\n//POS\r\n///NPOS {len(lines)},0,0,0,0,0\r\n///TOOL 0\r\n"
        head += "///POSTYPE BASE\r\n///RECTAN\r\n///RCONF 1,0,0,0,0,0,0,0,0\r\n"
        poses = [f"C{k:05d}={','.join(row)}\r\n" for k, row in enumerate(lines)]
        return head + "".join(poses) + "//INST\r\n///DATE 2024/01/01 10:00\r\nNOP\r\nMOVJ C00000 VJ=5.00\r\nEND\r\n"
    if maker == "kawasaki":
        poses = [f"cal{k} {' '.join(row)}\n" for k, row in enumerate(lines)]
        return ".NETCONF     192.168.0.2\n.TRANS\n" + "".join(poses) + ".END\n.JOINTS\n#home 0 0 0 0 0 0\n.END\n"
    raise AssertionError(maker)


def beside(T, X, W):
    """Return what the camera of eye-in-hand sees: camera_T_target with T X C = W."""
    return np.linalg.inv(T @ X) @ W
