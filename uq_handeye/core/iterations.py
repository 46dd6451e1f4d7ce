"""Number of steps after which an iteration ends that has not converged.

Iterations that converge need far fewer steps: quadratic ones fewer than 20, linear ones up to some hundred where the
noise is large. One that reaches the limit is reported as not converged.
"""

from __future__ import annotations

MAX_STEPS = 500
