"""``uq-handeye`` and ``python -m uq_handeye``: the command, with Ctrl-C caught also while it is being loaded."""

import sys


def main() -> None:
    """Run the command line."""
    try:
        from .cli.app import main as run

        run()
    except KeyboardInterrupt:
        print("uq-handeye: interrupted", file=sys.stderr)
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
