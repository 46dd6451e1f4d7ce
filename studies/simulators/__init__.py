"""Pictures of a board that MuJoCo renders, from a camera on an arm: intrinsics, signs, textures, and X.

`cell` is the arm, its poses and the board, `measure` renders and measures, and writes ``measured.json``.
"""
