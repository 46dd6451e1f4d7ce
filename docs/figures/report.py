"""The pictures of the report in the README and in docs/report.md.

    python docs/figures/report.py [FOLDER]

Writes to FOLDER, docs/images if left out: report_demo.png and report_demo_dark.png (first screen of the report of
`demo`), report_signed.png and report_pages.png (first screen and two pages of the PDF, with a title block and a
tolerance), and demo_comparison.png (the figure of `compare`), all of the embedded data set. Needs Chromium with its
driver, Selenium (extra `test`) and pdftoppm.
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
from uq_handeye.core.presentation.ellipses import render
from uq_handeye.core.presentation.page import FLAGS, find_browser, to_pdf
from uq_handeye.read import write_files
from uq_handeye.report.comparison.compare import compare_result
from uq_handeye.report.comparison.figure import comparison_picture
from uq_handeye.report.page import report_html

sys.path.insert(0, str(Path(__file__).parent))
from shown import png, visible_words, words_of

WIDTH, HEIGHT, PAGES, COLUMNS, GAP = 1280, 860, 2, 2, 10
ABOUT = {"cell": "Demo", "robot": "simulated arm", "camera": "simulated camera", "operator": "uq-handeye demo"}
TOLERANCE = "2mm,0.2deg"


def screen(page: Path, profile: str, dark: bool, size: tuple[int, int] = (WIDTH, HEIGHT)) -> bytes:
    """Return the first screen of a page as PNG."""
    options = webdriver.ChromeOptions()
    options.binary_location = str(find_browser())
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
        words = visible_words(driver)
    finally:
        driver.quit()
    return png(Image.open(io.BytesIO(base64.b64decode(data))), words)


def pages(pdf: Path) -> bytes:
    """Return the first pages side by side as PNG."""
    subprocess.run(["pdftoppm", "-png", "-r", "72", "-l", str(PAGES), pdf, pdf.with_suffix("")], check=True)
    images = [Image.open(file) for file in sorted(pdf.parent.glob(f"{pdf.stem}-*.png"))]
    width, height = images[0].size
    rows = -(-len(images) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * (width + GAP) + GAP, rows * (height + GAP) + GAP), "#9aa0a6")
    for k, image in enumerate(images):
        sheet.paste(image, (GAP + k % COLUMNS * (width + GAP), GAP + k // COLUMNS * (height + GAP)))
    text = subprocess.run(["pdftotext", "-l", str(PAGES), pdf, "-"], check=True, capture_output=True, text=True).stdout
    return png(sheet, words_of(text))


def main(folder: Path) -> None:
    with resources.as_file(resources.files("uq_handeye") / "data") as data:
        poses = uq.read_poses(data / "robot.csv", data / "camera.csv")
    result = uq.calibrate(poses)
    signed = replace(result, about=ABOUT)
    compared, verdict = compare_result(result), signed.verdict(TOLERANCE)
    picture = None if compared.comparison is None else comparison_picture(compared.comparison)
    assert picture is not None
    demo = report_html(result, comparison=compared)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        page, pdf = Path(scratch) / "report.html", Path(scratch) / "report.pdf"
        page.write_text(demo, encoding="utf-8")
        found = {
            f"report_demo{'_dark' if dark else ''}.png": screen(page, f"{scratch}/{dark}", dark)
            for dark in (False, True)
        }
        page.write_text(report_html(signed, comparison=compared, verdict=verdict), encoding="utf-8")
        found["report_signed.png"] = screen(page, f"{scratch}/signed", dark=False)
        pdf.write_bytes(to_pdf(report_html(signed, verdict=verdict, folded=False)))
        found["report_pages.png"] = pages(pdf)
    write_files(folder, found | {"demo_comparison.png": render(picture.figure, "png")})


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "images")
