"""Fail if a page of the built documentation would load anything from elsewhere: scripts, styles, images, fonts."""

import re
import sys
from pathlib import Path

LOADS = re.compile(
    r"""<(?:script|img|iframe|source)\b[^>]*\bsrc=["'](?:https?:)?//[^"']+"""
    r"""|<link\b[^>]*\brel=["'](?:stylesheet|preload|icon)["'][^>]*\bhref=["'](?:https?:)?//[^"']+"""
    r"""|(?:url\(|@import\s+)["']?(?:https?:)?//[^"')]+"""
)
# A namespace or comment in a style is no request; only what a browser would fetch is looked at.
found = [
    f"{file}: {match.group()[:160]}"
    for file in sorted(Path(sys.argv[1]).rglob("*"))
    if file.suffix in (".html", ".css")
    for match in LOADS.finditer(file.read_text(encoding="utf-8"))
]
print("\n".join(found) or "no page loads anything from elsewhere")
sys.exit(bool(found))
