"""The whole functions as programs that answer problems, and the problems: those with an answer and those without."""

import importlib
import re
import sys
from types import SimpleNamespace

import drivers
import numpy as np
from support import moved, noisy_motions, random_covariance, random_transforms, rotations, transforms

STATUS = {
    "ok": 0,
    "too few": 1,
    "no rotation": 2,
    "parallel": 3,
    "mirrored": 4,
    "not finite": 5,
    "no pose": 6,
    "no covariance": 7,
    "other X": 8,
}
MESSAGES = {  # of Python and Octave
    1: "ewer than 2|2 or more",
    2: "o pair turns|none of them rotates",
    3: "ll rotation axes are parallel",
    4: "mirrored",
}
UNTOUCHED = 7.0

DRIVER = """#include <stdio.h>
#include "covariance_4dpa.{suffix}"
#include "solve_4dpa.{suffix}"
{using}
static double data[100000], answer[54];
int main(void)
{{
    FILE *from = fopen("in.bin", "rb"), *to = fopen("out.bin", "wb");
    double n;
    while (fread(&n, 8, 1, from) == 1) {{
        const int pairs = (int)n;
        moments_4dpa moments;
        covariance_sums_4dpa sums;
        int i, status = OK_4DPA;
        if (fread(data, 8, 104 * pairs, from) != (size_t)(104 * pairs)) return 1;
        for (i = 0; i < 54; i++) answer[i] = 7.0;
        clear_4dpa(&moments);
        for (i = 0; i < pairs && status == OK_4DPA; i++)
            status = accumulate_4dpa(&moments, data + 104 * i, data + 104 * i + 16);
        if (status == OK_4DPA) status = solve_4dpa(&moments, answer + 1);
        answer[0] = status;
        if (status == OK_4DPA) status = begin_covariance_4dpa(&sums, answer + 1);
        for (i = 0; i < pairs && status == OK_4DPA; i++)
            status = accumulate_covariance_4dpa(&sums, data + 104 * i, data + 104 * i + 16,
                                                data + 104 * i + 32, data + 104 * i + 68);
        if (status == OK_4DPA) status = covariance_4dpa(&sums, answer + 18);
        answer[17] = status;
        fwrite(answer, 8, 54, to);
    }}
    fclose(from);
    return fclose(to);
}}
"""


class Compiled:
    """C or C++ as one program that answers a list of problems."""

    def __init__(self, language, folder, into, options):
        compiler = drivers.tool(*{"c": ("gcc", "cc"), "cpp": ("g++", "c++")}[language])
        self.folder = into
        for path in folder.glob("*_4dpa.*"):
            (into / path.name).write_bytes(path.read_bytes())
        suffix, using = ("h", "") if language == "c" else ("hpp", "using namespace handeye;")
        (into / f"driver.{language}").write_text(DRIVER.format(suffix=suffix, using=using))
        sources = [f"driver.{language}", *(["solve_4dpa.c", "covariance_4dpa.c"] if language == "c" else [])]
        standard = "-std=c99" if language == "c" else "-std=c++11"
        drivers.run(compiler, standard, *drivers.WARNINGS, *options, *sources, "-o", "driver", "-lm", cwd=into)

    def __call__(self, problems):
        parts = []
        for A, B, S_A, S_B in problems:
            rows = [
                np.reshape(T, (len(A), -1)) for T in (A, B, *(np.broadcast_to(S, (len(A), 6, 6)) for S in (S_A, S_B)))
            ]
            parts += [[float(len(A))], np.concatenate(rows, axis=1).ravel()]
        np.concatenate(parts).tofile(self.folder / "in.bin")
        drivers.run("./driver", cwd=self.folder)
        return [
            SimpleNamespace(status=int(a[0]), X=a[1:17].reshape(4, 4), status_of_S=int(a[17]), S=a[18:].reshape(6, 6))
            for a in np.fromfile(self.folder / "out.bin").reshape(-1, 54)
        ]


class Imported:
    """The Python files, imported from their folder; errors become the status of C."""

    def __init__(self, folder, monkeypatch):
        monkeypatch.syspath_prepend(str(folder))
        for name in ("solve_4dpa", "covariance_4dpa"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        self.solve, self.covariance = (importlib.import_module(n) for n in ("solve_4dpa", "covariance_4dpa"))

    def __call__(self, problems):
        return [self._one(*problem) for problem in problems]

    def _one(self, A, B, S_A, S_B):
        answer = SimpleNamespace(X=np.full((4, 4), UNTOUCHED), S=np.full((6, 6), UNTOUCHED), status=0)
        moments = self.solve.Moments()
        try:
            for pair in zip(A, B, strict=True):
                self.solve.accumulate_4dpa(moments, *pair)
            answer.X = self.solve.solve_4dpa(moments)
        except ValueError as error:
            answer.status = _status_of(str(error))
        answer.status_of_S = answer.status
        if answer.status == 0:
            try:
                answer.S = self.covariance.covariance_4dpa(A, B, S_A, S_B, answer.X)
            except ValueError as error:
                answer.status_of_S = _status_of(str(error))
        return answer


def _status_of(message):
    table = {**MESSAGES, 5: "finite numbers", 6: "to hold poses", 7: "to hold covariances"}
    return next(status for status, words in table.items() if re.search(words, message))


# ------------------------------------------------------------------------------------------------- good problems


def good_problems():
    """name -> A, B, Sigma_A, Sigma_B."""
    rng = np.random.default_rng(20190508)
    problems = {}

    def add(name, A, B, length=1.0, per_pair=False):
        shape = (len(A),) if per_pair else ()
        unit = np.diag([1.0] * 3 + [length] * 3)
        S_A, S_B = (unit @ random_covariance(rng, shape=shape) @ unit for _ in range(2))
        problems[name] = (A, B, S_A, S_B)

    for N in (2, 3, 60):
        _, A, B = noisy_motions(rng, N)
        add(f"N = {N}", A, B, per_pair=N == 60)
    _, A, B = noisy_motions(rng, 60, sd=0.0)
    add("exact", A, B)
    _, A, B = noisy_motions(rng, 2, sd=0.0)
    add("two exact", A, B)
    for name, length in (("huge", 1e9), ("tiny", 1e-9), ("immense", 1e60)):
        _, A, B = noisy_motions(rng, 10)
        A, B = A.copy(), B.copy()
        A[:, :3, 3] *= length
        B[:, :3, 3] *= length
        add(f"{name} lengths", A, B, length)
    for angle in (1e-6, 1e-4, 1e-2):
        _, A, B = noisy_motions(rng, 20, sd=0.0, smallest=angle, largest=2 * angle)
        add(f"angles of {angle:g}", A, B)
    _, A, B = noisy_motions(rng, 20, sd=0.0, smallest=np.pi - 1e-4, largest=np.pi - 1e-5)
    add("near pi", A, B)
    # motions that count nothing beside those that count
    _, A, B = noisy_motions(rng, 12)
    A, B = A.copy(), B.copy()
    A[:2] = B[:2] = np.eye(4)
    A[2] = transforms(rotations(np.array([1e-12, 0, 0])), rng.normal(size=3))
    B[2] = transforms(rotations(np.array([0, 2e-12, 0])), rng.normal(size=3))
    A[3] = B[3] = transforms(rotations(np.array([0, 0, np.pi])), rng.normal(size=3))
    A[4, :3, :3] = B[4, :3, :3] = np.eye(3)
    add("with motions that do not turn", A, B)
    _, A, B = noisy_motions(rng, 8)
    A, B = A.copy(), B.copy()
    A[:, :3, 3] = B[:, :3, 3] = 0.0
    add("no translations", A, B)
    axis = np.array([0.2, -0.5, 0.8])
    v = axis + 1e-2 * rng.normal(size=(30, 3))
    X = random_transforms(rng)
    B = transforms(rotations(v), rng.normal(size=(30, 3)))
    add("nearly parallel axes", X @ B @ np.linalg.inv(X), B)
    # axes in a plane: H has rank 2
    v = np.column_stack([rng.normal(size=(9, 2)), np.zeros(9)])
    B = transforms(rotations(v), rng.normal(size=(9, 3)))
    add("axes in a plane", X @ B @ np.linalg.inv(X), B)
    return problems


GOOD = good_problems()
# How much more than 1e-13 the roundings of two orders of summation come to: t_X is a ratio of sums that cancel to
# angle^2, of terms as large as the angle, here of the motions or between the axes.
CONDITION = {"angles of 1e-06": 1e4, "angles of 0.0001": 1e2, "near pi": 1e4, "nearly parallel axes": 1e2}


# -------------------------------------------------------------------------------------------- what has no answer


def degenerate_problems():
    """name -> status, A, B."""
    rng = np.random.default_rng(7)
    X = random_transforms(rng)

    def conjugated(B):
        return X @ B @ np.linalg.inv(X), B

    axis = np.array([0.6, 0.0, 0.8])
    t = rng.normal(size=(10, 3))
    parallel = transforms(rotations(axis * rng.uniform(0.3, 2, (10, 1))), t)
    flipped = transforms(rotations(axis * rng.uniform(0.3, 2, (10, 1)) * np.array([[1], [-1]] * 5)), t)
    still = np.broadcast_to(np.eye(4), (10, 4, 4))
    half = transforms(rotations(np.pi * np.eye(3)), t[:3])
    A = random_transforms(rng, (10,))
    quarter = transforms(rotations(np.eye(3)), t[:3])
    return {
        "parallel axes": ("parallel", *conjugated(parallel)),
        "axes along a line, both ways": ("parallel", *conjugated(flipped)),
        "parallel up to rounding": ("parallel", *conjugated(moved(parallel, 1e-9 * rng.normal(size=(10, 6))))),
        "no motion": ("no rotation", still, still),
        "pure translation": ("no rotation", *conjugated(transforms(np.broadcast_to(np.eye(3), (10, 3, 3)), t))),
        "angles of 1e-12": ("no rotation", *conjugated(transforms(rotations(1e-12 * t), t))),
        "half turns": ("no rotation", half, half),
        "mirrored": ("mirrored", np.linalg.inv(quarter), quarter),
        "one turns, the other does not": ("no rotation", A, np.broadcast_to(np.eye(4), A.shape)),
    }


DEGENERATE = degenerate_problems()
