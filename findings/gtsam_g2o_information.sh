#!/usr/bin/env bash
# gtsam 4.3.0 and g2o-python 0.0.12: one file of a pose graph, two meanings of its rotation weights.
#
# Both write and read `EDGE_SE3:QUAT` with an information matrix. Expected: a file that gtsam writes means the same in g2o, whose
# format it is. Seen: g2o's error of a rotation is the vector of the quaternion, half an angle, so that 400 means 0.1 rad; gtsam
# takes the number for the angle itself and writes 100 for 0.1 rad, in six digits. Read by g2o, each rotation of a gtsam file has
# a standard deviation twice as large, a quarter of the weight against the translations; a g2o file in gtsam the reverse.
# Besides, `SparseOptimizer.load` of the Python package says True and leaves the graph empty: edges have to be made by hand.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==1.26.4" "gtsam==4.3.0" "g2o-python==0.0.12" || exit 2
cd "$folder"
"$folder/env/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import g2o
import gtsam
import numpy as np

SD_RAD, SD_M, TURN_RAD, SHIFT_M = 0.1, 0.05, 0.02, 0.03
measured = gtsam.Pose3(gtsam.Rot3.Rodrigues(np.array([TURN_RAD, 0, 0])), np.array([0, SHIFT_M, 0]))
graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
graph.add(gtsam.BetweenFactorPose3(0, 1, measured, gtsam.noiseModel.Diagonal.Sigmas(np.array([SD_RAD] * 3 + [SD_M] * 3))))
for name in (0, 1):
    values.insert(name, gtsam.Pose3())
gtsam.writeG2o(graph, values, "graph.g2o")
edge = next(line for line in open("graph.g2o") if line.startswith("EDGE_SE3:QUAT")).split()
upper = np.array(edge[10:], float)  # of the matrix, translation first
information = np.zeros((6, 6))
information[np.triu_indices(6)] = upper
print(f"gtsam {version('gtsam')} writes a rotation of {SD_RAD} rad as {information[5, 5]:g}, {SD_M} m as {information[0, 0]:g}")

vertices = []
for name in (0, 1):
    vertex = g2o.VertexSE3()
    vertex.set_id(name)
    vertex.set_estimate(g2o.Isometry3d(np.eye(3), np.zeros(3)))
    vertices.append(vertex)
parts = {}
for part, turn, shift in (("rotation", TURN_RAD, 0.0), ("translation", 0.0, SHIFT_M)):
    rotation = gtsam.Rot3.Rodrigues(np.array([turn, 0, 0])).matrix()
    edge = g2o.EdgeSE3()
    for number, vertex in enumerate(vertices):
        edge.set_vertex(number, vertex)
    edge.set_measurement(g2o.Isometry3d(rotation, np.array([0, shift, 0])))
    edge.set_information(information)
    edge.compute_error()
    alone, noise = gtsam.NonlinearFactorGraph(), gtsam.noiseModel.Diagonal.Sigmas(np.array([SD_RAD] * 3 + [SD_M] * 3))
    alone.add(gtsam.BetweenFactorPose3(0, 1, gtsam.Pose3(gtsam.Rot3(rotation), np.array([0, shift, 0])), noise))
    parts[part] = edge.chi2(), 2 * alone.error(values)
    print(f"  {part}: chi2 {parts[part][0]:.5f} in g2o-python {version('g2o-python')}, {parts[part][1]:.5f} in gtsam")
again, _ = gtsam.readG2o("graph.g2o", True)
optimizer = g2o.SparseOptimizer()
said = optimizer.load("graph.g2o")
print(f"  g2o's load says {said} and has {len(optimizer.vertices())} vertices, {len(optimizer.edges())} edges")
same = abs(information[5, 5] - SD_RAD**-2) < 1e-6 and abs(parts["rotation"][0] / parts["rotation"][1] - 0.25) < 1e-3
same &= abs(parts["translation"][0] / parts["translation"][1] - 1) < 1e-6
same &= abs(again.error(values) / graph.error(values) - 1) < 1e-4
same &= said and not optimizer.edges()
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
