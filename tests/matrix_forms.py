"""Poses written as matrices in the ways that are met, by an encoder of its own: rows of numbers to text."""

import json

import numpy as np
from support import SEED


def rig_of(n=30):
    """Robot and camera poses (n, 4, 4) of one X and W; with half turns, and angles at their singularities."""
    rng = np.random.default_rng(SEED)
    robot = np.stack(
        [pose(rotation(rng.normal(size=3), rng.uniform(0.2, 3.0)), rng.uniform(-1, 1, 3)) for _ in range(n)]
    )
    for k, axis in enumerate(np.eye(3)):
        robot[k + 1, :3, :3] = rotation(axis, np.pi)
        robot[k + 5, :3, :3] = rotation(axis, np.pi / 2)
    X = pose(rotation([1.0, 2.0, -1.0], 0.7), [0.05, -0.02, 0.11])
    W = pose(rotation([-1.0, 0.5, 2.0], 2.0), [0.7, 0.3, -0.2])
    return robot, np.linalg.inv(X) @ np.linalg.inv(robot) @ W


def rotation(axis, angle):
    """Rodrigues' formula."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def pose(R, t):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def rows16(T):
    return [list(M.reshape(16)) for M in T]


def columns16(T):
    return [[M[i, j] for j in range(4) for i in range(4)] for M in T]


def rows12(T):
    return [list(M[:3].reshape(12)) for M in T]


def lines(rows, mark=" ", form=repr, begin="", end="\n"):
    return "".join(begin + mark.join(form(float(v)) for v in row) + end for row in rows)


def blocks(T, rows=4, mark=" ", between="", form=repr):
    out = []
    for k, M in enumerate(T):
        label = between.format(k=k, n=k + 1)
        out.append(label + "".join(mark.join(form(float(v)) for v in row) + "\n" for row in M[:rows]))
    return "".join(out)


def bracketed(T, sep, row_sep, name="T{n} = ", end="\n"):
    out = []
    for k, M in enumerate(T):
        body = row_sep.join(sep.join(repr(float(v)) for v in row) for row in M)
        out.append(name.format(k=k, n=k + 1) + "[" + body + "]" + end)
    return "".join(out)


def numpy_text(T):
    with np.printoptions(precision=17, threshold=10**6, floatmode="unique"):
        return "\n".join(str(M) for M in T)


def numpy_repr(T):
    with np.printoptions(precision=17, threshold=10**6, floatmode="unique"):
        return repr(T)


def matlab_display(T):
    return "".join(
        f"\nT(:,:,{k + 1}) =\n\n" + "".join("".join(f"{v:25.16f}" for v in row) + "\n" for row in M) + "\n"
        for k, M in enumerate(T)
    )


def names(stem, first=0, rows=4):
    return [stem.format(i=i, j=j) for i in range(first, first + rows) for j in range(first, first + 4)]


def table(header, rows, mark=",", form=repr):
    return mark.join(header) + "\n" + lines(rows, mark, form)


def comma(value):
    return repr(value).replace(".", ",")


def wide(value):
    return f"{value:+.17E}"


def rotation_then_translation(T):
    return [[*M[:3, :3].reshape(9), *M[:3, 3]] for M in T]


def indexed(rows, first=0):
    return [[float(k + first), *row] for k, row in enumerate(rows)]


def timed(rows):
    return [[1700000000.25 + 0.5 * k, *row] for k, row in enumerate(rows)]


def shuffled(header, rows):
    """A table with its columns in another order, and some that mean nothing here."""
    order = np.random.default_rng(1).permutation(len(header))
    return ["note", *(header[k] for k in order), "exposure"], [[1.5, *(row[k] for k in order), 7.0] for row in rows]


R33 = ["r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33"]

# Name -> text of poses (n, 4, 4).
FORMS = {
    "16 by rows": lambda T: lines(rows16(T)),
    "16 by columns": lambda T: lines(columns16(T)),
    "16, commas": lambda T: lines(rows16(T), ","),
    "16, commas and blanks": lambda T: lines(rows16(T), ", "),
    "16, semicolons": lambda T: lines(rows16(T), ";"),
    "16, tabs": lambda T: lines(rows16(T), "\t"),
    "16, decimal commas": lambda T: lines(rows16(T), ";", comma),
    "16, decimal commas, blanks": lambda T: lines(rows16(T), " ", comma),
    "16, savetxt": lambda T: lines(rows16(T), " ", wide),
    "16, Windows": lambda T: "\ufeff" + lines(rows16(T), ",", end="\r\n"),
    "16, commented": lambda T: "# base to tool, m\n\n% more\n// more\n" + lines(rows16(T), end="  # taken\n"),
    "16, row numbers": lambda T: lines(indexed(rows16(T))),
    "16, row numbers from 1": lambda T: lines(indexed(rows16(T), 1), ","),
    "16, times": lambda T: lines(timed(rows16(T))),
    "16 by columns, times": lambda T: lines(timed(columns16(T)), ","),
    "16, pictures": lambda T: "".join(f"img_{k:03d}.png {lines([row])}" for k, row in enumerate(rows16(T))),
    "16, names": lambda T: "".join(f"pose_{k}: {lines([row])}" for k, row in enumerate(rows16(T))),
    "16, pandas": lambda T: ",".join(map(str, range(16))) + "\n" + lines(rows16(T), ","),
    "16, NDJSON": lambda T: "".join(json.dumps([float(v) for v in row]) + "\n" for row in rows16(T)),
    "KITTI": lambda T: lines(rows12(T), " ", lambda v: f"{v:.12e}"),
    "12, commas, row numbers": lambda T: lines(indexed(rows12(T)), ","),
    "12, times": lambda T: lines(timed(rows12(T))),
    "4 lines": lambda T: blocks(T),
    "4 lines, blank lines": lambda T: blocks(T, between="\n"),
    "4 lines, labels": lambda T: blocks(T, between="Pose {n}\n"),
    "4 lines, labels with colons": lambda T: blocks(T, between="pose {k}:\n"),
    "4 lines, comments": lambda T: blocks(T, between="# pose {k}\n", mark=", "),
    "4 lines, numbers": lambda T: blocks(T, between="{k}\n"),
    "4 lines, three numbers": lambda T: blocks(T, between="{k} {k} {n}\n", mark="\t"),
    "4 lines, commas": lambda T: blocks(T, mark=","),
    "4 lines, semicolons": lambda T: blocks(T, mark=";", form=comma),
    "4 lines, transposed": lambda T: blocks(np.swapaxes(T, 1, 2)),
    "3 lines": lambda T: blocks(T, rows=3),
    "3 lines, labels": lambda T: blocks(T, rows=3, between="T_{k}\n"),
    "MATLAB": lambda T: bracketed(T, " ", "; ", end=";\n"),
    "MATLAB, commas": lambda T: bracketed(T, ", ", ";\n ", name="T(:,:,{n}) = "),
    "MATLAB, continued": lambda T: bracketed(T, " ", "; ...\n", name="T{{{n}}} = "),
    "MATLAB shown": matlab_display,
    "Python": lambda T: "".join(f"T_{k} = {M.tolist()}\n" for k, M in enumerate(T)),
    "Python, np.array": lambda T: "".join(f"poses.append(np.array({M.tolist()}, dtype=np.float64))\n" for M in T),
    "NumPy shown": numpy_text,
    "NumPy repr": numpy_repr,
    "Eigen": lambda T: blocks(T, mark="  ", form=lambda v: f"{v:20.15g}"),
    "C++": lambda T: "".join("{" + ", ".join(f"{v!r}" for v in row) + "},\n" for row in np.array(rows16(T)).tolist()),
    "columns r11, tx": lambda T: table([*R33, "tx", "ty", "tz"], rotation_then_translation(T)),
    "columns R_11, t1": lambda T: table(
        [n.upper() for n in R33] + ["t1", "t2", "t3"], rotation_then_translation(T), ";"
    ),
    "columns, m": lambda T: table(names("m{i}{j}"), rows16(T)),
    "columns, m of 12": lambda T: table(names("M{i}{j}", 1, 3), rows12(T), ";", comma),
    "columns, T_0_0": lambda T: table(names("T_{i}_{j}"), rows16(T), "\t"),
    "columns, T[0][0]": lambda T: table(names("T[{i}][{j}]"), rows16(T)),
    "columns, counted": lambda T: table([f"m{k}" for k in range(1, 17)], columns16(T)),
    "columns, shuffled": lambda T: table(*shuffled(names("a{i}{j}", 1), rows16(T))),
    "columns, times": lambda T: table(["time", *names("T{i}{j}")], timed(rows16(T))),
    "columns, blanks": lambda T: "# " + table(["timestamp", *names("r{i}{j}", 1, 3)], timed(rows12(T)), " "),
}

NOAP = ["nx", "ox", "ax", "px", "ny", "oy", "ay", "py", "nz", "oz", "az", "pz"]
FORMS |= {
    "16, times last": lambda T: lines([[*row, 0.5 * k] for k, row in enumerate(rows16(T))]),
    "16, pictures last": lambda T: "".join(lines([row], end=f" img{k}.png\n") for k, row in enumerate(rows16(T))),
    "16, all on one line": lambda T: " ".join(lines(rows16(T)).split()),
    "16, pandas with an index": lambda T: "," + ",".join(map(str, range(16))) + "\n" + lines(indexed(rows16(T)), ","),
    "a list in a field": lambda T: "id,pose\n" + "".join(f'{k},"{M.tolist()}"\n' for k, M in enumerate(T)),
    "4 lines, bars": lambda T: blocks(T, mark=" | "),
    "4 lines, rules": lambda T: blocks(T, between="--- pose {k} ---\n"),
    "4 lines, count first": lambda T: f"{len(T)}\n" + blocks(T),
    "R and t": lambda T: "".join("R =\n" + lines(M[:3, :3].tolist()) + "t =\n" + lines(M[:3, 3:].tolist()) for M in T),
    "torch": lambda T: f"tensor({T.tolist()}, dtype=torch.float64)",
    "SymPy": lambda T: "".join("Matrix([\n" + ",\n".join(map(str, M.tolist())) + "])\n" for M in T),
    "columns, noap": lambda T: table(NOAP, rows12(T)),
    "columns, r1 to r9": lambda T: table(
        [f"r{k}" for k in range(1, 10)] + ["x", "y", "z"], rotation_then_translation(T)
    ),
}

STATE = {"q": [0.0] * 7, "F_T_EE": list(np.eye(4).reshape(16)), "robot_mode": "Idle"}


def state(row, **more):
    return {"O_T_EE": row, "O_T_EE_d": list(np.eye(4).reshape(16)), **STATE, **more}


def franka_columns(stem, first=0):
    return [stem.format(k=k) for k in range(first, first + 16)]


def franka_echo(T):
    out = []
    for row in columns16(T):
        out.append(
            "header:\n  stamp: 0\nF_T_EE: [1.0, 0.0, 0.0]\nO_T_EE: ["
            + ", ".join(map(repr, map(float, row)))
            + "]\n---\n"
        )
    return "".join(out)


FRANKA = {
    "csv": lambda T: table(franka_columns("O_T_EE_{k}"), columns16(T)),
    "csv, brackets": lambda T: table(franka_columns("O_T_EE[{k}]"), columns16(T)),
    "csv, from 1": lambda T: table(franka_columns("O_T_EE{k}", 1), columns16(T), ", "),
    "csv, PlotJuggler": lambda T: table(
        ["__time", *franka_columns("/franka/franka_states/O_T_EE[{k}]")], timed(columns16(T))
    ),
    "csv, among others": lambda T: table(
        [*franka_columns("O_T_EE_d_{k}"), *franka_columns("O_T_EE_{k}"), *franka_columns("F_T_EE_{k}")],
        [[*np.eye(4).reshape(16), *row, *np.eye(4).reshape(16)] for row in columns16(T)],
    ),
    "json": lambda T: json.dumps([state(list(map(float, row))) for row in columns16(T)], indent=1),
    "json, one key": lambda T: json.dumps({"O_T_EE": [list(map(float, row)) for row in columns16(T)]}),
    "states": lambda T: "".join(json.dumps(state(list(map(float, row)))) + "\n" for row in columns16(T)),
    "echo": franka_echo,
    "echo, list": lambda T: "".join(
        "O_T_EE:\n" + lines([[v] for v in row], begin="- ") + "---\n" for row in columns16(T)
    ),
}
