"""The matrices printed in the paper, transcribed entry by entry: a known-answer table.

Source: J. Wu, Y. Sun, M. Wang, M. Liu, "Hand-eye Calibration: 4D Procrustes Analysis Approach", preprint of
May 2019: R_L and R_R from (17), K from (19), P_i, Q_i and J_jk from Appendix A. Nothing is corrected here.

Symbols: q_L = (a, b, c, d), q_R = (p, q, r, s); Hij, eij, zij are the entries of H, E, Z. The factor
1/sqrt(2) in front of the printed P_i and Q_i is left out.
"""

PRINTED = {
    "R_L": """
        a, -b, -c, -d
        b, a, -d, c
        c, d, a, -b
        d, -c, b, a
    """,
    "R_R": """
        p, -q, -r, -s
        q, p, s, -r
        r, -s, p, q
        s, r, -q, p
    """,
    "K": """
        H11 + H22 + H33 + H44, H12 - H21 - H34 + H43, H13 + H24 - H31 - H42, H14 - H23 + H32 - H41
        H12 - H21 + H34 - H43, H33 - H22 - H11 + H44, H14 - H23 - H32 + H41, -H13 - H24 - H31 - H42
        H13 - H24 - H31 + H42, -H14 - H23 - H32 - H41, H22 - H11 - H33 + H44, H12 + H21 - H34 - H43
        H14 + H23 - H32 - H41, H13 - H24 + H31 - H42, -H12 - H21 - H34 - H43, H22 - H11 + H33 - H44
    """,
    "P_1": """
        p, -q, -r, -s, a, -b, -c, -d
        q, p, s, -r, b, a, -d, c
        r, -s, p, q, c, d, a, -b
        s, r, -q, p, d, -c, b, a
    """,
    "P_2": """
        -q, -p, s, -r, -b, -a, -d, c
        p, -q, r, s, a, -b, c, d
        -s, -r, -q, p, d, -c, -b, -a
        r, -s, -p, -q, -c, -d, a, -b
    """,
    "P_3": """
        -r, -s, -p, q, -c, d, -a, -b
        s, -r, -q, -p, -d, -c, -b, a
        p, q, -r, s, a, b, -c, d
        -q, p, -s, -r, b, -a, -d, -c
    """,
    "P_4": """
        -s, r, -q, -p, -d, -c, b, -a
        -r, -s, p, -q, c, -d, -a, -b
        q, -p, -s, -r, -b, a, -d, -c
        p, q, r, -s, a, b, c, -d
    """,
    "Q_1": """
        p, -q, -r, -s, a, -b, -c, -d
        -q, -p, s, -r, -b, -a, -d, c
        -r, -s, -p, q, -c, d, -a, -b
        -s, r, -q, -p, -d, -c, b, -a
    """,
    "Q_2": """
        q, p, s, -r, b, a, -d, c
        p, -q, r, s, a, -b, c, d
        s, -r, -q, -p, -d, -c, -b, a
        -r, -s, p, -q, c, -d, -a, -b
    """,
    "Q_3": """
        r, -s, p, q, c, d, a, -b
        -s, -r, -q, p, d, -c, -b, -a
        p, q, -r, s, a, b, -c, d
        q, -p, -s, -r, -b, a, -d, -c
    """,
    "Q_4": """
        s, r, -q, p, d, -c, b, a
        r, -s, -p, -q, -c, -d, a, -b
        -q, p, -s, -r, b, -a, -d, -c
        p, q, r, -s, a, b, c, -d
    """,
    "J_11": """
        e11 - z11, e12 + z21, e13 + z31, e14 + z41
        e12 + z21, z11 - e11, e14 - z41, z31 - e13
        e13 + z31, z41 - e14, z11 - e11, e12 - z21
        e14 + z41, e13 - z31, z21 - e12, z11 - e11
    """,
    "J_12": """
        e21 - z21, e22 - z11, e23 + z41, e24 - z31
        e22 - z11, z21 - e21, e24 + z31, z41 - e23
        e23 - z41, z31 - e24, -e21 - z21, e22 - z11
        e24 + z31, e23 + z41, z11 - e22, -e21 - z21
    """,
    "J_13": """
        e31 - z31, e32 - z41, e33 - z11, e34 + z21
        e32 + z41, -e31 - z31, e34 + z21, z11 - e33
        e33 - z11, z21 - e34, z31 - e31, e32 + z41
        e34 - z21, e33 - z11, z41 - e32, -e31 - z31
    """,
    "J_14": """
        e41 - z41, e42 + z31, e43 - z21, e44 - z11
        e42 - z31, -e41 - z41, e44 - z11, z21 - e43
        e43 + z21, z11 - e44, -e41 - z41, e42 + z31
        e44 - z11, e43 + z21, z31 - e42, z41 - e41
    """,
    "J_21": """
        e12 - z12, z22 - e11, e14 + z32, z42 - e13
        z22 - e11, z12 - e12, -e13 - z42, z32 - e14
        z32 - e14, z42 - e13, e12 + z12, e11 - z22
        e13 + z42, -e14 - z32, z22 - e11, e12 + z12
    """,
    "J_22": """
        e22 - z22, -e21 - z12, e24 + z42, -e23 - z32
        -e21 - z12, z22 - e22, z32 - e23, z42 - e24
        -e24 - z42, z32 - e23, e22 - z22, e21 - z12
        e23 + z32, z42 - e24, z12 - e21, e22 - z22
    """,
    "J_23": """
        e32 - z32, -e31 - z42, e34 - z12, z22 - e33
        z42 - e31, -e32 - z32, z22 - e33, z12 - e34
        -e34 - z12, z22 - e33, e32 + z32, e31 + z42
        e33 - z22, -e34 - z12, z42 - e31, e32 - z32
    """,
    "J_24": """
        e42 - z42, z32 - e41, e44 - z22, -e43 - z12
        -e41 - z32, -e42 - z42, -e43 - z12, z22 - e44
        z22 - e44, z12 - e43, e42 - z42, e41 + z32
        e43 - z12, z22 - e44, z32 - e41, e42 + z42
    """,
    "J_31": """
        e13 - z13, z23 - e14, z33 - e11, e12 + z43
        e14 + z23, e13 + z13, -e12 - z43, z33 - e11
        z33 - e11, z43 - e12, z13 - e13, -e14 - z23
        z43 - e12, e11 - z33, z23 - e14, e13 + z13
    """,
    "J_32": """
        e23 - z23, -e24 - z13, z43 - e21, e22 - z33
        e24 - z13, e23 + z23, z33 - e22, z43 - e21
        -e21 - z43, z33 - e22, -e23 - z23, -e24 - z13
        z33 - e22, e21 + z43, z13 - e24, e23 - z23
    """,
    "J_33": """
        e33 - z33, -e34 - z43, -e31 - z13, e32 + z23
        e34 + z43, e33 - z33, z23 - e32, z13 - e31
        -e31 - z13, z23 - e32, z33 - e33, z43 - e34
        -e32 - z23, e31 - z13, z43 - e34, e33 - z33
    """,
    "J_34": """
        e43 - z43, z33 - e44, -e41 - z23, e42 - z13
        e44 - z33, e43 - z43, -e42 - z13, z23 - e41
        z23 - e41, z13 - e42, -e43 - z23, z33 - e44
        -e42 - z13, e41 + z23, z33 - e44, e43 + z43
    """,
    "J_41": """
        e14 - z14, e13 + z24, z34 - e12, z44 - e11
        z24 - e13, e14 + z14, e11 - z44, z34 - e12
        e12 + z34, z44 - e11, e14 + z14, -e13 - z24
        z44 - e11, -e12 - z34, z24 - e13, z14 - e14
    """,
    "J_42": """
        e24 - z24, e23 - z14, z44 - e22, -e21 - z34
        -e23 - z14, e24 + z24, e21 + z34, z44 - e22
        e22 - z44, z34 - e21, e24 - z24, -e23 - z14
        z34 - e21, z44 - e22, z14 - e23, -e24 - z24
    """,
    "J_43": """
        e34 - z34, e33 - z44, -e32 - z14, z24 - e31
        z44 - e33, e34 - z34, e31 + z24, z14 - e32
        e32 - z14, z24 - e31, e34 + z34, z44 - e33
        -e31 - z24, -e32 - z14, z44 - e33, -e34 - z34
    """,
    "J_44": """
        e44 - z44, e43 + z34, -e42 - z24, -e41 - z14
        -e43 - z34, e44 - z44, e41 - z14, z24 - e42
        e42 + z24, z14 - e41, e44 - z44, z34 - e43
        -e41 - z14, z24 - e42, z34 - e43, z44 - e44
    """,
}
