"""Pictures of pages that hold the words they show, so that a check can tell whether a picture is up to date.

A browser of another version draws other pixels, the words of the page are the same. They are kept in the PNG itself, as
its text chunk ``shown``.
"""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

from PIL import Image
from PIL.PngImagePlugin import PngInfo

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

CHUNK = "shown"
# Words that differ from run to run: dates, times of day, the version of the program, folders.
PASSING = re.compile(r"\d{4}-\d\d-\d\d|\d\d:\d\d(:\d\d)?|\b\d+\.\d+\.\d+\b|/\S+/\S*")
# Words inside the window: those of elements that the window does not cut off.
VISIBLE = """
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
const words = [];
while (walker.nextNode()) {
  const range = document.createRange();
  range.selectNodeContents(walker.currentNode);
  const box = range.getBoundingClientRect();
  const seen = box.width > 0 && box.top >= 0 && box.bottom <= window.innerHeight;
  const drawn = walker.currentNode.parentElement.closest('script, style, svg, canvas');
  if (seen && !drawn) words.push(walker.currentNode.data);
}
return words.join(' ');
"""


def words_of(text: str) -> str:
    """Return the words of a page in one line, without those that differ from run to run."""
    return " ".join(PASSING.sub("", text).split())


def visible_words(driver: Chrome) -> str:
    """Return the words that the browser's window shows."""
    return words_of(driver.execute_script(VISIBLE))


def png(image: Image.Image, words: str) -> bytes:
    """Encode in 128 colours, which a page of text does not miss, with its words."""
    info, buffer = PngInfo(), io.BytesIO()
    info.add_itxt(CHUNK, words)
    image.convert("RGB").quantize(128).save(buffer, format="PNG", optimize=True, pnginfo=info)
    return buffer.getvalue()


def words_in(picture: bytes) -> str | None:
    """Return the words that a picture holds, None if it holds none."""
    return Image.open(io.BytesIO(picture)).info.get(CHUNK)
