"""``python -m uq_handeye``: the command ``uq-handeye``."""

from .cli import main

if __name__ == "__main__":
    main()
