"""Tables I to V of the paper as printed, for comparison."""

from __future__ import annotations

import pandas as pd

SIZES = (224, 253, 298, 342, 392, 433, 470, 500)  # "measurements": consecutive motions (6)
CLASSICAL = ("tsai", "chou", "park", "daniilidis", "andreff")  # Table II
RECENT = ("heller", "zhang", "zhao")  # Table III
PAPER = (*CLASSICAL, *RECENT, "4dpa")

# Table I: type, parameterisation or basic tools, speed, accuracy, uncertainty description.
_TABLE_1 = {
    "tsai": ("Separated, Analytical", "Rotation Logarithms", "High", "Medium", "No"),
    "shiu": ("Separated, Analytical", "Rotation Logarithms", "Low", "Low", "No"),
    "park": ("Separated, Analytical", "Rotation Logarithms, SVD", "Medium", "Medium", "No"),
    "horaud": ("Separated, Analytical", "Rotation Logarithms, Eigen-decomposition", "High", "Medium", "No"),
    "chou": ("Separated, Analytical", "Quaternion, SVD", "High", "Medium", "No"),
    "daniilidis": ("Simultaneous, Analytical", "Dual Quaternion, SVD", "Medium", "Medium", "No"),
    "andreff": ("Simultaneous, Analytical", "Sylvester Equation, Kronecker Product", "High", "Medium", "No"),
    "lu": ("Simultaneous, Analytical", "Quaternion, SVD", "Low", "Medium", "No"),
    "gwak": ("Simultaneous, Optimization", "Gradient/Newton Method", "Very Low", "High", "No"),
    "heller": ("Simultaneous, Optimization", "Quaternion, Dual Quaternion, LMI", "Very Low", "High", "No"),
    "condurache": ("Simultaneous, Analytical", "Dual Tensor, SVD or QR Decomposition", "Medium", "Medium", "No"),
    "zhang": ("Simultaneous, Optimization", "Dual Quaternion, Pseudo Inverse", "Medium", "Medium", "No"),
    "zhao": (
        "Simultaneous, Optimization",
        "Dual Quaternion, Alternative Linear Programming",
        "Very Low",
        "High",
        "No",
    ),
    "nguyen": ("Separated, Optimization", "Rotation Iteration", "Very Low", "High", "Yes"),
}

# As printed, per case: error (62) and seconds in the order of PAPER.
_TABLES_2_3 = {
    224: "1.2046e-2 4.0506e-2 6.8255e-3 1.0190e-2 6.8254e-3 3.5959e-2 6.7082e-3 3.8308e-2 7.2650e-3 5.7292e-3 "
    "7.9803e-3 1.4586e-2 7.6125e-3 8.8201e-3 7.1485e-3 8.0861e-2 6.7857e-3 4.4819e-3",
    253: "1.0243e-2 4.2952e-2 5.8650e-3 1.1760e-2 5.8650e-3 3.9486e-2 5.7704e-3 4.1492e-2 5.8754e-3 6.8972e-3 "
    "6.7894e-3 1.5661e-2 6.7908e-3 9.7096e-3 6.1710e-3 1.0787e-1 5.8290e-3 4.8991e-3",
    298: "8.0653e-3 4.9823e-2 5.0514e-3 1.3105e-2 5.0517e-3 4.6559e-2 4.9084e-3 4.8626e-2 5.4648e-3 7.2326e-3 "
    "5.6508e-3 1.8173e-2 6.0203e-3 1.2561e-2 5.3021e-3 1.4893e-1 4.9803e-3 5.5470e-3",
    342: "6.8136e-3 5.3854e-2 4.7192e-3 1.4585e-2 4.7254e-3 5.6970e-2 4.0379e-3 5.3721e-2 4.8374e-3 6.7880e-3 "
    "4.7192e-3 2.2755e-2 5.2743e-3 1.5332e-2 4.4003e-3 2.2291e-1 4.0207e-3 5.5404e-3",
    392: "5.5242e-3 6.3039e-2 3.4047e-3 1.7253e-2 3.4012e-3 6.0697e-2 3.3850e-3 6.4505e-2 4.0410e-3 8.9159e-3 "
    "3.8706e-3 2.5399e-2 4.3269e-3 1.8800e-2 3.6041e-3 3.0347e-1 3.1678e-3 7.3957e-3",
    433: "4.8072e-3 6.7117e-2 2.9723e-3 1.8354e-2 2.9694e-3 6.9967e-2 2.8957e-3 6.5703e-2 3.6410e-3 9.8837e-3 "
    "3.3504e-3 2.6373e-2 3.9732e-3 2.1613e-2 3.1658e-3 3.8768e-1 2.7890e-3 7.8954e-3",
    470: "4.3853e-3 7.6869e-2 2.7302e-3 1.9827e-2 2.7270e-3 1.9827e-2 2.6640e-3 7.5553e-2 3.3262e-3 1.0373e-2 "
    "3.0547e-3 2.7973e-2 3.3633e-3 2.5498e-2 2.8912e-3 5.0153e-1 2.5397e-3 8.1632e-3",
    500: "4.0938e-3 8.5545e-2 2.5855e-3 2.1506e-2 2.5807e-3 7.5722e-2 2.4610e-3 7.7225e-2 3.0083e-3 1.2008e-2 "
    "2.8862e-3 2.9879e-2 3.0215e-3 3.2041e-2 2.6871e-3 5.8727e-1 2.3137e-3 8.5382e-3",
}

# Metres, X, Y and Z of the error of a trajectory: before and after the calibration, by experiment.
TABLE_IV = {
    1: ((1.997, 0.725), (1.803, 0.476), (0.828, 0.379)),
    2: ((2.278, 1.080), (1.722, 0.997), (1.322, 0.763)),
    3: ((1.463, 0.605), (1.825, 0.583), (1.199, 0.691)),
}
# The same "after" in experiment 3, by d.
TABLE_V = {
    1e3: (2.068, 1.275, 2.342),
    1e4: (1.472, 0.637, 1.944),
    1e5: (1.463, 0.605, 1.825),
    1e6: (1.462, 0.600, 1.799),
    1e7: (1.462, 0.599, 1.798),
}


def errors_and_times() -> pd.DataFrame:
    """Tables II and III of the paper: N, method, error62, seconds."""
    rows = []
    for N, line in _TABLES_2_3.items():
        values = [float(value) for value in line.split()]
        rows += [(N, method, *values[2 * k : 2 * k + 2]) for k, method in enumerate(PAPER)]
    return pd.DataFrame(rows, columns=["N", "method", "error62", "seconds"])


def classes() -> pd.DataFrame:
    """Table I: method, type, tools, speed, accuracy, uncertainty; 4DPA has no row in it."""
    columns = ["method", "type", "tools", "speed", "accuracy", "uncertainty"]
    return pd.DataFrame([(name, *row) for name, row in _TABLE_1.items()], columns=columns)
