"""The registry: every closed form of the toolkit, once. It drives tests, cache, code and docs.

To add a matrix, write its derivation in one of the topical modules and give it a line here.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from sympy import Matrix, Symbol

from . import derivatives, limit, octonion, procrustes, so4


class Argument(NamedTuple):
    """One input: its name in code, core shape, the symbol of each entry the derivation uses, its meaning."""

    name: str
    shape: tuple[int, ...]
    symbols: tuple[tuple[Symbol, tuple[int, ...]], ...]
    meaning: str


class ClosedForm(NamedTuple):
    """One derived matrix. `shape` is (rows, columns), or (rows,) for a vector.

    `topic` groups the forms into modules; `equation` is the number in the paper, or the theory's section.
    """

    name: str
    topic: str
    arguments: tuple[Argument, ...]
    shape: tuple[int, ...]
    equation: str
    meaning: str
    derive: Callable[[], Matrix]

    @property
    def size(self) -> int:
        """Number of entries."""
        return self.shape[0] * (self.shape[1] if len(self.shape) == 2 else 1)

    @property
    def symbols(self) -> frozenset[Symbol]:
        """All symbols that may occur in the entries."""
        return frozenset(symbol for argument in self.arguments for symbol, _ in argument.symbols)


def _matrix(name: str, values: Matrix, meaning: str) -> Argument:
    places = tuple((values[i, j], (i, j)) for i in range(values.rows) for j in range(values.cols))
    return Argument(name, values.shape, places, meaning)


def _vector(name: str, values: Matrix, meaning: str) -> Argument:
    return Argument(name, (len(values),), tuple((value, (i,)) for i, value in enumerate(values)), meaning)


_E, _Z, _H = (octonion.entries(prefix) for prefix in "ezH")
_q = octonion.coordinates("q", 4, first=0)
_sigma = octonion.coordinates("s", 8)
_R, _t = so4.pose()
_d = Symbol("d")

E = _matrix("E", _E, "image of A in SO(4)")
Z = _matrix("Z", _Z, "image of B in SO(4)")
X = _matrix("E", _E, "any 4x4 matrix, E or Z of a pair")
H = _matrix("H", _H, "H = sum (u - mean u)(v - mean v)^T for v = R u + t, (15)")
q = _vector("q", _q, "quaternion, scalar first")
sigma = _vector("sigma", _sigma, "octonion (q_L, q_R)/sqrt(2), (18)")
T = Argument(
    "T",
    (4, 4),
    tuple((_R[i, j], (i, j)) for i in range(3) for j in range(3)) + tuple((_t[i], (i, 3)) for i in range(3)),
    "homogeneous pose (R, t); its last row is not read",
)
d = Argument("d", (), ((_d, ()),), "scaling factor, in the length unit of T")

TOPICS = {
    "octonion": "Quaternion products, the octonion sigma and its factors P_i, Q_i: (16)-(21), (28).",
    "problem1": "Problem 1, registration on SO(4): K and W, (19)-(26).",
    "problem2": "Problem 2, E R = R Z: J_jk, F11, F22 of one pair, (29)-(35), and their collapse T1.",
    "so4": "Maps from SE(3) to SO(4) with the scaling factor d: (49)-(51).",
    "limit": "What remains of a pose as d goes to infinity: u and w, theory T2.",
    "derivatives": "Derivatives for the covariances: by the data (43), (45); by the pose error (theta, tau).",
}

_VEC = "vec column-major, b = (vec E, vec Z)"
_XI = "xi = (theta, tau): R' = exp([theta]x) R, t' = t + tau, at xi = 0"
_SIDES = (("L", "F11", "sum_jk J_jk J_jk^T", "q_L"), ("R", "F22", "sum_jk J_jk^T J_jk", "q_R"))


def _octonion_forms() -> list[ClosedForm]:
    make = partial(ClosedForm, topic="octonion")
    return [
        make(
            name="R_L",
            arguments=(q,),
            shape=(4, 4),
            equation="(17)",
            meaning="Matrix of the left product, q * x = R_L(q) x",
            derive=lambda: octonion.R_L(_q),
        ),
        make(
            name="R_R",
            arguments=(q,),
            shape=(4, 4),
            equation="(17)",
            meaning="Matrix of the right product, x * q = R_R(q) x",
            derive=lambda: octonion.R_R(_q),
        ),
        make(
            name="sigma_to_R",
            arguments=(sigma,),
            shape=(4, 4),
            equation="(16), (18)",
            meaning="R = R_L(q_L) R_R(q_R)",
            derive=lambda: octonion.rotation(_sigma),
        ),
        *(
            make(
                name=f"P_{i}",
                arguments=(sigma,),
                shape=(4, 8),
                equation="(20), (54)",
                meaning=f"Column {i} of R is P_{i}(sigma) sigma, its derivative by sigma is 2 P_{i}(sigma)",
                derive=partial(octonion.P, i, _sigma),
            )
            for i in range(1, 5)
        ),
        *(
            make(
                name=f"Q_{i}",
                arguments=(sigma,),
                shape=(4, 8),
                equation="(28), transposed",
                meaning=f"Row {i} of R is Q_{i}(sigma) sigma, its derivative by sigma is 2 Q_{i}(sigma)",
                derive=partial(octonion.Q, i, _sigma),
            )
            for i in range(1, 5)
        ),
    ]


def _procrustes_forms() -> list[ClosedForm]:
    return [
        ClosedForm(
            "K",
            "problem1",
            (H,),
            (4, 4),
            "(19)",
            "q_L^T K q_R = tr(R H)",
            lambda: procrustes.K(_H),
        ),
        ClosedForm(
            "W",
            "problem1",
            (H,),
            (8, 8),
            "(25)",
            "sigma^T W sigma = tr(R H); W = [[0, K], [K^T, 0]]",
            lambda: procrustes.W(_H),
        ),
        *(
            ClosedForm(
                f"J_{j}{k}",
                "problem2",
                (E, Z),
                (4, 4),
                "(29)-(31)",
                f"Row {k}, column {j} of E R - R Z is q_L^T J_{j}{k} q_R",
                partial(procrustes.J, j, k, _E, _Z),
            )
            for j, k in procrustes.INDICES
        ),
        *(
            ClosedForm(
                name,
                "problem2",
                (E, Z),
                (4, 4),
                "(35), T1",
                f"{name} = {total} of one pair; {vector}: eigenvector of the smallest eigenvalue of the sum",
                partial(procrustes.F, side, _E, _Z),
            )
            for side, name, total, vector in _SIDES
        ),
        ClosedForm(
            "a_left",
            "problem2",
            (X,),
            (4,),
            "T1",
            "Left coordinates a_k = <L_k, E>/4 with L_k = R_L(e_k)",
            lambda: procrustes.a_left(_E),
        ),
        ClosedForm(
            "c_right",
            "problem2",
            (X,),
            (4,),
            "T1",
            "Right coordinates c_k = <M_k, E>/4 with M_k = R_R(e_k)",
            lambda: procrustes.c_right(_E),
        ),
    ]


def _pose_forms() -> list[ClosedForm]:
    return [
        ClosedForm(
            "F1",
            "so4",
            (T, d),
            (4, 4),
            "(49), (50)",
            "[[R, t/d], [t^T R/d, 1]]; orthogonal up to 1/d only, as F1 F1^T has 2 t/d off the diagonal",
            lambda: so4.F1(_R, _t, _d),
        ),
        ClosedForm(
            "F2",
            "so4",
            (T, d),
            (4, 4),
            "(51)",
            "[[R, t/d], [-t^T R/d, 1]]; orthogonal up to 1/d^2",
            lambda: so4.F2(_R, _t, _d),
        ),
        ClosedForm("u", "limit", (T,), (3,), "T2", "u = vee(R)/2 = sin(angle) axis", limit.u),
        ClosedForm("w", "limit", (T,), (3,), "T2", "w = (t + R^T t)/2, in the length unit of T", limit.w),
    ]


def _image(embed: Callable[[Matrix, Matrix, Symbol], Matrix], R: Matrix, t: Matrix) -> Matrix:
    """F1 or F2 of a pose, at the registered symbol of d."""
    return embed(R, t, _d)


def _reading(derive: Callable[[], Matrix], R: Matrix, t: Matrix) -> Matrix:
    """u or w, derived in the general pose, of another pose."""
    return limit.at_pose(derive(), R, t)


def _derivative_forms() -> list[ClosedForm]:
    maps = (("F1", so4.F1, "(50)"), ("F2", so4.F2, "(51)"))
    vectors = (("u", limit.u), ("w", limit.w))
    return [
        *(
            ClosedForm(
                f"d{name}_db",
                "derivatives",
                (E, Z),
                (16, 32),
                "(43), (45)",
                f"d vec({name})/d b of one pair; {_VEC}",
                partial(derivatives.dF_db, side, _E, _Z),
            )
            for side, name, _, _ in _SIDES
        ),
        *(
            ClosedForm(
                f"d{name}q_db",
                "derivatives",
                (E, Z, q),
                (4, 32),
                "(42), (43), (45)",
                f"d({name} q)/d b = (q^T kron I) d vec({name})/d b of one pair, q held; {_VEC}",
                partial(derivatives.dFq_db, side, _E, _Z, _q),
            )
            for side, name, _, _ in _SIDES
        ),
        *(
            ClosedForm(
                f"d{name}_dxi",
                "derivatives",
                (T, d),
                (16, 6),
                equation,
                f"d vec({name}(T', d))/d xi, vec column-major; {_XI}",
                partial(derivatives.by_pose, partial(_image, embed)),
            )
            for name, embed, equation in maps
        ),
        *(
            ClosedForm(
                f"d{name}_dxi",
                "derivatives",
                (T,),
                (3, 6),
                "T2, T3",
                f"d {name}(T')/d xi; {_XI}",
                partial(derivatives.by_pose, partial(_reading, derive)),
            )
            for name, derive in vectors
        ),
    ]


# What the package itself runs; `generate` prints these into `uq_handeye/methods/_closed_form/`.
RUN = frozenset(
    {
        *("R_L", "R_R", "sigma_to_R", "P_1", "P_2", "P_3", "P_4"),
        *("F11", "F22", "F1", "F2", "dF11q_db", "dF22q_db", "dF2_dxi"),
    }
)

FORMS: dict[str, ClosedForm] = {
    form.name: form for form in (*_octonion_forms(), *_procrustes_forms(), *_pose_forms(), *_derivative_forms())
}
