"""Make every picture of README and pages, or check that they show what the program prints today.

    python docs/figures/all.py [--check] [NAME ...]

Without --check the pictures in docs/images are written again. With it they are made in a scratch folder, and the exit
status is 1 if one is missing, has another size, or shows other words than the one in docs/images; pixels may differ
with the version of the browser and of Matplotlib. NAME chooses scripts. Needs Chromium with its driver, pdftoppm and
the extra `test`.
"""

from __future__ import annotations

import argparse
import importlib
import os
import platform
import re
import sys
import tempfile
from pathlib import Path

# The kernels of the tests, before NumPy is loaded: estimated sizes amplify the rounding in which kernels differ.
if platform.machine() in ("x86_64", "AMD64"):
    os.environ.setdefault("OPENBLAS_CORETYPE", "Haswell")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

FIGURES = Path(__file__).parent
IMAGES = FIGURES.parent / "images"
sys.path.insert(0, str(FIGURES))

SCRIPTS = ("architecture", "conventions", "workspace", "report", "good_and_bad", "live")
SVG_TEXT = re.compile(r"<(?:text|title|desc)\b[^>]*>([^<]*)<|<!-- (.*?) -->")


def words_in_svg(text: str) -> str:
    """Return the words of a drawing, as its text elements or Matplotlib's comments have them."""
    return " ".join(" ".join(part for part in found if part) for found in SVG_TEXT.findall(text))


def difference(kept: Path, made: Path) -> str | None:
    """Return in what a picture differs from the one made now, None if it shows the same."""
    from PIL import Image
    from shown import words_in

    if not kept.exists():
        return "is missing"
    if kept.suffix == ".svg":
        same = words_in_svg(kept.read_text(encoding="utf-8")) == words_in_svg(made.read_text(encoding="utf-8"))
        return None if same else "has other words"
    sizes = [Image.open(file).size for file in (kept, made)]
    if sizes[0] != sizes[1]:
        return f"has {sizes[0]} pixels, made now {sizes[1]}"
    before, now = words_in(kept.read_bytes()), words_in(made.read_bytes())
    if before == now:
        return None
    old, new = (before or "").split(), (now or "").split()
    k = next((k for k, (a, b) in enumerate(zip(old, new, strict=False)) if a != b), min(len(old), len(new)))
    shows, made_now = (" ".join(part[max(k - 4, 0) : k + 4]) for part in (old, new))
    return f"shows '... {shows} ...', made now '... {made_now} ...'"


def main(names: list[str], check: bool) -> int:
    """Make the pictures of the scripts, or compare them; return the exit status."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) if check else IMAGES
        for name in names or SCRIPTS:
            print(f"docs/figures/{name}.py", flush=True)
            importlib.import_module(name).main(folder)
        wrong = [] if not check else [
            f"docs/images/{made.name} {found}: run python docs/figures/all.py and look at it"
            for made in sorted(folder.iterdir())
            if (found := difference(IMAGES / made.name, made)) is not None
        ]  # fmt: skip
    print("\n".join(wrong) if wrong else "all pictures show what the program prints")
    return 1 if wrong else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Make every picture of README and pages, or check them.")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("names", nargs="*", choices=[*SCRIPTS, []])
    given = parser.parse_args()
    sys.exit(main(given.names, given.check))
