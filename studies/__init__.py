"""Studies: the claims of the paper, of other programs and of this toolkit, each measured by one script.

``python -m studies`` lists them. Timings are of one thread in BLAS, which has to be said before NumPy is loaded.
"""

import os

for _variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
