"""The pictures of the report in the README and in docs/report.md.

    python docs/figures/report.py [FOLDER]

Writes report_demo.png, report_demo_dark.png (the first screen in a browser) and report_pages.png (the two pages of the
PDF) to FOLDER, docs/images if left out: the report of the embedded data set. Needs Chromium with its driver, Selenium
(extra `test`) and pdftoppm.
"""

from __future__ import annotations

import base64
import io
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from importlib import resources
from pathlib import Path

from PIL import Image
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

import uq_handeye as uq
from uq_handeye.core.presentation.page import FLAGS, found_browser, to_pdf
from uq_handeye.read import write_files
from uq_handeye.report.comparison.compare import compare_beside
from uq_handeye.report.page import report_html

WIDTH, HEIGHT, PAGES, COLUMNS, GAP = 1280, 860, 2, 2, 10
ABOUT = {"cell": "Demo", "robot": "simulated arm", "camera": "simulated camera", "operator": "uq-handeye demo"}
TOLERANCE = "2mm,0.2deg"


def png(image: Image.Image) -> bytes:
    """Encode in 128 colours, which a page of text does not miss."""
    buffer = io.BytesIO()
    image.convert("RGB").quantize(128).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def screen(page: Path, profile: str, dark: bool, size: tuple[int, int] = (WIDTH, HEIGHT)) -> Image.Image:
    options = webdriver.ChromeOptions()
    options.binary_location = str(found_browser())
    for flag in (*FLAGS, "--hide-scrollbars", f"--user-data-dir={profile}"):
        options.add_argument(flag)
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
        driver.get(page.as_uri())
        data = driver.execute_cdp_cmd("Page.captureScreenshot", {"format": "png"})["data"]
    finally:
        driver.quit()
    return Image.open(io.BytesIO(base64.b64decode(data)))


def pages(pdf: Path) -> Image.Image:
    """The first pages beside each other."""
    subprocess.run(["pdftoppm", "-png", "-r", "72", "-l", str(PAGES), pdf, pdf.with_suffix("")], check=True)
    images = [Image.open(file) for file in sorted(pdf.parent.glob(f"{pdf.stem}-*.png"))]
    width, height = images[0].size
    rows = -(-len(images) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * (width + GAP) + GAP, rows * (height + GAP) + GAP), "#9aa0a6")
    for k, image in enumerate(images):
        sheet.paste(image, (GAP + k % COLUMNS * (width + GAP), GAP + k // COLUMNS * (height + GAP)))
    return sheet


def main(folder: Path) -> None:
    with resources.as_file(resources.files("uq_handeye") / "data") as data:
        poses = uq.read_poses(data / "robot.csv", data / "camera.csv")
    result = uq.calibrate(poses)
    result = replace(result, about=ABOUT)
    verdict = result.verdict(TOLERANCE)
    html = report_html(result, comparison=compare_beside(result), verdict=verdict)
    printed = report_html(result, verdict=verdict, folded=False)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        page, pdf = Path(scratch) / "report.html", Path(scratch) / "report.pdf"
        page.write_text(html, encoding="utf-8")
        pdf.write_bytes(to_pdf(printed))
        found = {
            f"report_demo{'_dark' if dark else ''}.png": png(screen(page, f"{scratch}/{dark}", dark))
            for dark in (False, True)
        }
        write_files(folder, found | {"report_pages.png": png(pages(pdf))})


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "images")
