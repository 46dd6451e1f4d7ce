"""``uq-handeye`` and ``python -m uq_handeye``: the command, with Ctrl-C caught also while it is being loaded."""

import gc
import os
import sys


def main() -> None:
    """Run the command line.

    Linear algebra keeps to one thread, unless the environment says otherwise: matrices of a hundred rows are just
    large enough for several, which wait for each other far longer than one takes (`core.threads`). Garbage is looked
    for less often than by default: importing makes ten thousand objects that all stay.
    """
    for variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):  # before NumPy is loaded
        os.environ.setdefault(variable, "1")
    gc.set_threshold(1_000_000)
    try:
        from .cli.app import main as run

        run()
    except KeyboardInterrupt:
        print("uq-handeye: interrupted", file=sys.stderr)
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
