"""The studies with the first line of what they say of themselves.

python -m studies
"""

from __future__ import annotations

import ast
from pathlib import Path


def described() -> dict[str, str]:
    """List what can be run: the studies and the scripts of `performance`, by name, with their first lines. Nothing
    is imported.
    """
    here = Path(__file__).parent
    scripts = [path.with_name("__init__.py") for path in here.glob("*/__main__.py")]
    scripts += [path for path in (here / "performance").glob("*.py") if path.name != "__init__.py"]
    found = {}
    for path in scripts:
        name = ".".join(("studies", *path.relative_to(here).with_suffix("").parts)).removesuffix(".__init__")
        docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
        found[name] = (docstring or "").partition("\n")[0]
    return dict(sorted(found.items()))


if __name__ == "__main__":
    print("python -m studies.NAME [--full] [-o FOLDER]\n")
    for name, line in described().items():
        print(f"{name}\n    {line}")
