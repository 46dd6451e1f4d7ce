#!/usr/bin/env bash
# pycolmap 4.2.1: max_num_features does not bound the number of features that SIFT on the CPU returns.
#
# Expected: FeatureExtractionOptions.sift.max_num_features = 1000 gives at most 1,000 features a picture. Seen: more, here
# on a picture of random squares. Who plans time and memory of matching by the limit (both grow with its square) has to cut
# the features by their size afterwards.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "pycolmap==4.2.1" || exit 2
"$folder/env/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import pycolmap

grey = np.kron(np.random.default_rng(0).integers(0, 255, (120, 160)), np.ones((8, 8))).astype(np.uint8)
bitmap, exceeded = pycolmap.Bitmap.from_array(grey), False
print(f"pycolmap {version('pycolmap')}: a picture of 1280 x 960 pixels")
for limit in (500, 1000, 2000):
    options = pycolmap.FeatureExtractionOptions()
    options.sift.max_num_features, options.num_threads, options.use_gpu = limit, 1, False
    keypoints, _ = pycolmap.FeatureExtractor.create(options).extract(bitmap)
    print(f"  max_num_features {limit}: {len(keypoints)} features")
    exceeded |= len(keypoints) > limit
print("as described" if exceeded else "the behaviour has changed")
sys.exit(0 if exceeded else 1)
PY
