"""The studies with the first line of what they say of themselves.

python -m studies
"""

from __future__ import annotations

import ast
from pathlib import Path


def described() -> dict[str, str]:
    """Modules that run as a study, by name, with their first line. Nothing is imported for it."""
    found = {}
    here = Path(__file__).parent
    for path in sorted(here.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if path.name.startswith("__") or "\nif __name__ ==" not in text:
            continue
        name = ".".join(("studies", *path.relative_to(here).with_suffix("").parts))
        found[name] = (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
    return found


if __name__ == "__main__":
    print("python -m studies.NAME [--full] [-o FOLDER]\n")
    for name, line in described().items():
        print(f"{name}\n    {line}")
