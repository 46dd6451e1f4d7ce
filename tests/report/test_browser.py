"""The report in a real browser, headless Chromium, opened from disk."""

import json
import re
import shutil

import numpy as np
import pytest
from support import SEED, missing

import uq_handeye as uq
from uq_handeye.core.presentation import page as pdf

webdriver = pytest.importorskip("selenium.webdriver", reason="selenium (extra test) is not installed")
WebDriverWait = pytest.importorskip("selenium.webdriver.support.ui").WebDriverWait

CHROMIUM, DRIVER = pdf.find_browser(), shutil.which("chromedriver")
pytestmark = pytest.mark.browser

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
SHEETS = ["answer", "checks", "by-pose", "x", "ahead", "error", "budget"]
FOLDED = [
    "full", "ellipses", "residuals", "full-budget", "shared", "task-space", "observability", "noise", "covariances",
    "methods", "scope", "forms", "repeat",
]  # fmt: skip
WIDTHS = (1280, 390)


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Paths of two reports by name: one with everything, one of a published method with little."""
    folder = tmp_path_factory.mktemp("reports")
    poses = uq.simulate(n_poses=12, noise=NOISE, seed=SEED)
    camera = np.array(poses.camera)
    camera[4, :3, 3] += 0.1
    with pytest.warns(uq.InputWarning):
        full = uq.calibrate(uq.PosePairs(poses.robot, camera))
    bare = uq.calibrate(poses, noise=NOISE, method="park")
    found = {"full": folder / "full <b>&.html", "bare": folder / "bare.html"}
    full.report(found["full"])
    bare.report(found["bare"])
    return found


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    from selenium.webdriver.chrome.service import Service

    if CHROMIUM is None or DRIVER is None:
        missing("browser", "needs Chromium and chromedriver (Debian: chromium, chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (*pdf.FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    browser = webdriver.Chrome(options=options, service=Service(DRIVER))
    browser.get("about:blank")  # what the browser's own first page loads, slowly, is not of the report
    yield browser
    browser.quit()


def shown(driver, path, width=1280, scheme="light", script=True, opened=True):
    """Open a file by its path; ``opened``: with what is folded."""
    for log in ("browser", "performance"):
        driver.get_log(log)  # what came before
    driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": not script})
    driver.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    )
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    driver.get(path.as_uri())
    if opened and script:
        driver.execute_script("document.querySelectorAll('details').forEach(d => { d.open = true; })")


@pytest.mark.parametrize("name", ["full", "bare"])
def test_no_console_message_and_nothing_requested(driver, pages, name):
    shown(driver, pages[name])
    assert driver.get_log("browser") == []
    urls = []
    for entry in driver.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] == "Network.requestWillBeSent":
            urls.append(message["params"]["request"]["url"])
    # The browser's own first page may still be loading its parts.
    assert [url for url in urls if not url.startswith(("data:", "chrome:"))] == [pages[name].as_uri()]


@pytest.mark.parametrize("name", ["full", "bare"])
def test_every_section_is_there(driver, pages, name):
    shown(driver, pages[name])
    found = driver.execute_script("return Array.from(document.querySelectorAll('section'), s => s.id)")
    more = {"full": ["cautions", "rig"], "bare": []}[name]
    assert sorted(found) == sorted([*SHEETS, *more, *FOLDED])
    sizes = driver.execute_script("return Array.from(document.querySelectorAll('section'), s => s.offsetHeight)")
    assert min(sizes) > 60
    links = driver.execute_script("return Array.from(document.querySelectorAll('nav a'), a => a.hash.slice(1))")
    assert links == FOLDED


TOPS = "return arguments[0].map(s => document.querySelector(s).getBoundingClientRect().top + scrollY)"


def test_the_first_screen_has_number_checks_and_a_picture(driver, pages):
    shown(driver, pages["full"], opened=False)
    tops = driver.execute_script(TOPS, ["#answer .answer", "#checks table", "#by-pose svg", "#by-pose figcaption"])
    assert max(tops) < 800
    closed = driver.execute_script("return document.querySelectorAll('details[open]').length")
    assert closed == 0


def test_on_a_telephone_the_answer_comes_before_the_contents(driver, pages):
    shown(driver, pages["full"], 390, opened=False)
    answer, checks, contents, folded = driver.execute_script(TOPS, ["#answer .answer", "#checks", "nav", ".folded"])
    assert answer < 300 and answer < checks < contents < folded
    # What is wider than the screen scrolls in a box of its own, with a shadow where there is more.
    wide = driver.execute_script(
        "return Array.from(document.querySelectorAll('.scroll'), e => [e.scrollWidth > e.clientWidth,"
        " getComputedStyle(e).backgroundImage.includes('gradient'), getComputedStyle(e).overflowX])"
    )
    assert all(shadow and way == "auto" for over, shadow, way in wide)


def test_a_link_of_the_contents_opens_its_section(driver, pages):
    shown(driver, pages["full"], opened=False)
    driver.execute_script("document.querySelector('nav a[href=\"#noise\"]').click()")
    opened = "return Array.from(document.querySelectorAll('section.folded > details[open]'), d => d.parentElement.id)"
    WebDriverWait(driver, 5).until(lambda d: d.execute_script(opened) == ["noise"])
    # All of them for print, and closed again afterwards.
    driver.execute_script(
        "window.print = function () { window.printed = document.querySelectorAll('details[open]').length; }"
    )
    driver.execute_script("document.querySelector('button.print').click()")
    assert driver.execute_script("return window.printed") == len(FOLDED)
    driver.execute_script("window.dispatchEvent(new Event('afterprint'))")
    assert driver.execute_script(opened) == ["noise"]


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ["full", "bare"])
def test_no_overflow(driver, pages, name, width):
    shown(driver, pages[name], width)
    scroll, client = driver.execute_script("const e = document.documentElement; return [e.scrollWidth, e.clientWidth]")
    assert scroll <= client <= width
    drawings = driver.execute_script(
        "return Array.from(document.querySelectorAll('figure:not(.small) .drawing svg'), s => s.clientWidth)"
        ".filter(x => x)"
    )
    assert min(drawings) > 500  # a figure is scrolled on a telephone rather than unreadable


def test_headings_of_rows_are_not_one_word_per_line(driver, pages):
    shown(driver, pages["full"], 390)
    found = driver.execute_script(
        "return Array.from(document.querySelectorAll('tbody th')).map(e => {"
        "  const r = document.createRange(); r.selectNodeContents(e);"
        "  return [e.textContent, r.getBoundingClientRect().height / parseFloat(getComputedStyle(e).lineHeight)]; })"
    )
    assert len(found) > 50
    assert [(text, lines) for text, lines in found if round(lines) >= max(3, len(text.split()))] == []


# Contrast of every text with what is behind it (WCAG 2: relative luminance).
CONTRAST = """
function parsed(c) {
  const m = c.match(/rgba?\\(([^)]*)\\)/)[1].split(',').map(Number);
  return {rgb: m.slice(0, 3), a: m.length > 3 ? m[3] : 1};
}
function luminance(rgb) {
  const l = rgb.map(v => { v /= 255; return v <= 0.03928 ? v / 12.92 : Math.pow((v + 0.055) / 1.055, 2.4); });
  return 0.2126 * l[0] + 0.7152 * l[1] + 0.0722 * l[2];
}
function behind(e) {
  for (; e; e = e.parentElement) { const c = parsed(getComputedStyle(e).backgroundColor); if (c.a > 0) return c.rgb; }
  return [255, 255, 255];
}
const worst = [];
for (const e of document.querySelectorAll('body *')) {
  if (e.closest('svg') || e.tagName === 'SCRIPT') continue;
  if (!Array.from(e.childNodes).some(n => n.nodeType === 3 && n.textContent.trim())) continue;
  const a = luminance(parsed(getComputedStyle(e).color).rgb), b = luminance(behind(e));
  const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  worst.push([ratio, e.tagName + '.' + e.className]);
}
worst.sort((x, y) => x[0] - y[0]);
return [parsed(getComputedStyle(document.body).backgroundColor).rgb, worst[0], worst.length];
"""


# The least contrast of text, axes and marks of each figure with the page; grids, bands and maps may be fainter.
DRAWN = (
    CONTRAST.split("const worst")[0]
    + """
const paper = luminance(parsed(getComputedStyle(document.body).backgroundColor).rgb), found = {};
const skip = ['white', '#d9d9d9', '#dedede', '#e6e6e6', '#b2b2b2', '#999999', '#ebebeb', '#ffffff'];
for (const e of document.querySelectorAll('figure .drawing svg use, figure .drawing svg path')) {
  const stem = e.closest('figure').id, written = e.getAttribute('style') || '', style = getComputedStyle(e);
  if (stem === 'figure-task_space' || e.closest('defs') || e.classList.contains('grid')) continue;
  if (skip.some(c => written.includes(c))) continue;
  for (const colour of [style.fill, style.stroke]) {
    if (!colour.startsWith('rgb(')) continue;
    const a = luminance(parsed(colour).rgb), ratio = (Math.max(a, paper) + 0.05) / (Math.min(a, paper) + 0.05);
    found[stem] = Math.min(found[stem] || 21, ratio);
  }
}
return found;
"""
)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_contrast_in_both_modes(driver, pages, scheme):
    shown(driver, pages["full"], scheme=scheme)
    paper, (ratio, where), count = driver.execute_script(CONTRAST)
    assert (max(paper) < 60) if scheme == "dark" else (min(paper) > 230)
    assert count > 200
    assert ratio >= 4.5, where
    card = driver.execute_script("return getComputedStyle(document.querySelector('.folded .drawing')).backgroundColor")
    assert card == f"rgb({', '.join(str(int(part)) for part in paper)})"
    lines = driver.execute_script(DRAWN)
    assert len(lines) >= 4 and min(lines.values()) >= 3.0, lines  # WCAG: graphics


def test_copy_buttons_copy(driver, pages):
    from selenium.webdriver.common.by import By

    shown(driver, pages["full"])
    buttons = driver.find_elements(By.CSS_SELECTOR, "button.copy")
    assert len(buttons) > 5 and all(button.is_displayed() for button in buttons)
    # Without a permission to read the clipboard, what is written to it is caught on its way.
    driver.execute_script(
        "window.copied = []; const write = t => { window.copied.push(t); return Promise.resolve(); };"
        "Object.defineProperty(navigator, 'clipboard', {value: {writeText: write}, configurable: true});"
    )
    driver.execute_script("arguments[0].scrollIntoView()", buttons[0])
    buttons[0].click()
    first = driver.find_element(By.CSS_SELECTOR, ".code pre").get_property("textContent")
    assert driver.execute_script("return window.copied") == [first]
    assert "np.array" in first
    # And by the old way, where there is no clipboard for files.
    driver.execute_script(
        "Object.defineProperty(navigator, 'clipboard', {value: undefined, configurable: true});"
        "window.marked = ''; document.addEventListener('copy', () => {"
        "  const e = document.activeElement; window.marked = e.value; });"
    )
    buttons[1].click()
    second = driver.find_elements(By.CSS_SELECTOR, ".code pre")[1].get_property("textContent")
    assert driver.execute_script("return window.marked") == second
    assert buttons[1].text in ("Copied", "Select and copy by hand")
    assert driver.get_log("browser") == []


def test_the_rig_can_be_turned(driver, pages):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    shown(driver, pages["full"], width=390, scheme="dark")
    stage = driver.find_element(By.CSS_SELECTOR, "#figure-rig .stage")
    assert stage.get_attribute("tabindex") == "0" and "arrow keys" in stage.get_attribute("aria-label")
    assert not driver.find_element(By.CSS_SELECTOR, "#figure-rig .drawing").is_displayed()

    def now():
        driver.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
        return stage.get_property("innerHTML")

    first = now()
    assert first.count('class="camera') >= 11 and "grid 0." in first and "NaN" not in first
    stage.send_keys(Keys.ARROW_LEFT)
    turned = now()
    assert turned != first
    stage.send_keys(Keys.ARROW_RIGHT)
    assert now() == first
    webdriver.ActionChains(driver).drag_and_drop_by_offset(stage, 60, 20).perform()
    assert now() not in (first, turned)
    stage.send_keys("0")
    assert now() == first
    slider = driver.find_element(By.CSS_SELECTOR, "#figure-rig input[type=range]")
    before = slider.get_attribute("aria-valuetext")
    slider.send_keys(Keys.ARROW_LEFT)
    assert now() != first and slider.get_attribute("aria-valuetext") != before
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    assert driver.find_element(By.CSS_SELECTOR, "#figure-rig .drawing").is_displayed()
    assert not stage.is_displayed()
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    assert driver.get_log("browser") == []


def test_without_script_there_are_no_buttons(driver, pages):
    shown(driver, pages["full"], script=False)
    boxes = driver.execute_cdp_cmd("DOM.getDocument", {"depth": 1})
    node = driver.execute_cdp_cmd("DOM.querySelector", {"nodeId": boxes["root"]["nodeId"], "selector": "button.copy"})
    attributes = driver.execute_cdp_cmd("DOM.getAttributes", node)["attributes"]
    driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
    assert "hidden" in attributes
    assert driver.find_element("css selector", "#figure-rig .drawing").is_displayed()


def test_all_of_it_can_be_reached_by_keyboard(driver, pages):
    shown(driver, pages["full"], width=390)
    unreachable = driver.execute_script(
        "return Array.from(document.querySelectorAll('.scroll, .drawing, pre')).filter("
        "e => e.scrollWidth > e.clientWidth && e.tabIndex < 0).length"
    )
    assert unreachable == 0


def test_printed_by_the_browser(pages):
    printed = pdf._by_browser(pages["full"].read_text(encoding="utf-8"), CHROMIUM)
    assert printed.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b", printed)) == 2
    full = pages["full"].read_text(encoding="utf-8").replace("<details>", "<details open>")
    assert 6 <= len(re.findall(rb"/Type\s*/Page\b", pdf._by_browser(full, CHROMIUM))) <= 20


def test_a_figure_fits_on_a_page(driver, pages):
    shown(driver, pages["full"])
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    # 297 mm less the margins of @page, in CSS pixels.
    metrics = {"width": 665, "height": 994, "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    tallest = driver.execute_script(
        "return Math.max(...Array.from(document.querySelectorAll('figure'), f => f.getBoundingClientRect().height))"
    )
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    assert tallest < 990
