"""The page in a real browser, headless Chromium with software WebGL: slow pictures, so few tests that wait for what
is said."""

import json
import shutil
import time

import numpy as np
import pytest
from support import missing

import uq_handeye as uq
from uq_handeye.core.presentation import page as pdf
from uq_handeye.trials.simulation.several_cameras import simulate_rig
from uq_handeye.use.live_session.folder import Folder
from uq_handeye.use.live_session.session import Session

pytest.importorskip("viser", reason="viser (extra live) is not installed")
webdriver = pytest.importorskip("selenium.webdriver", reason="selenium (extra test) is not installed")
WebDriverWait = pytest.importorskip("selenium.webdriver.support.ui").WebDriverWait
from uq_handeye.use.live_session.page import Page  # noqa: E402
from uq_handeye.use.live_session.view import view_page  # noqa: E402

CHROMIUM, DRIVER = pdf.find_browser(), shutil.which("chromedriver")
pytestmark = pytest.mark.browser
FLAGS = [flag for flag in pdf.FLAGS if flag != "--disable-gpu"]
SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
DOWNLOADS = []  # the folder
COARSE = "&fixedDpr=0.2"  # fewer pixels to draw
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    from selenium.webdriver.chrome.service import Service

    if CHROMIUM is None or DRIVER is None:
        missing("browser", "needs Chromium and chromedriver (Debian: chromium, chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (*FLAGS, *SOFTWARE, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    DOWNLOADS.append(tmp_path_factory.mktemp("down"))
    options.add_experimental_option("prefs", {"download.default_directory": str(DOWNLOADS[0])})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    browser = webdriver.Chrome(options=options, service=Service(DRIVER))
    browser.set_window_size(700, 500)
    browser.set_page_load_timeout(30)
    yield browser
    browser.quit()


@pytest.fixture
def page(tmp_path, driver):
    shown = Page(Session(Folder(tmp_path / "session")), port=0)
    yield shown
    leave(driver, shown)


def leave(driver, page):
    """Close a page that the browser has left, so that it misses nothing."""
    driver.get("about:blank")
    page.close()
    driver.get_log("browser")


def until(driver, question, *given):
    """Wait until the page answers a question with something true, and return it."""
    return WebDriverWait(driver, 30, 0.1).until(lambda d: d.execute_script(f"return {question}", *given))


def press(driver, label):
    """Click a button by its label."""
    find = "Array.from(document.querySelectorAll('button')).find(b => b.innerText.trim() == arguments[0])"
    until(driver, f"!!{find}", label)
    driver.execute_script(f"{find}.click()", label)


def upload(driver, label, path):
    find = "Array.from(document.querySelectorAll('button')).find(b => b.innerText.trim() == arguments[0])"
    until(driver, f"!!{find}", label)
    driver.execute_script(f"return {find}.parentElement.querySelector('input')", label).send_keys(str(path))


def said(driver, text):
    """Wait until the answer holds a text."""
    until(driver, "(document.getElementById('uq-answer') || {innerText: ''}).innerText.includes(arguments[0])", text)


def choose(driver, k):
    """Click a row of the table."""
    row = f"document.querySelector('#uq-poses tr[data-pose=\"{k}\"]')"
    until(driver, f"!!{row}")
    driver.execute_script(f"{row}.click()")
    until(driver, f"{row}.className.includes('chosen')")
    return row


def errors(driver):
    """Return what the console calls an error."""
    return [entry for entry in driver.get_log("browser") if entry["level"] == "SEVERE"]


def test_two_files_one_pose_left_out_and_the_report(driver, page, tmp_path, capfd):
    """Follow a first-time user, five clicks and under a minute; and nothing is asked of another machine."""
    poses = uq.simulate(n_poses=12, noise=NOISE, seed=5)
    for side in ("robot", "camera"):
        uq.write_pose_file(tmp_path / f"my <b>{side}.csv", getattr(poses, side))
    started = time.monotonic()
    driver.get(page.url + COARSE)
    said(driver, "No poses yet")
    driver.execute_script("window.clicks = 0; document.addEventListener('click', () => window.clicks++, true)")
    upload(driver, "Add robot poses", tmp_path / "my <b>robot.csv")
    upload(driver, "Add camera poses", tmp_path / "my <b>camera.csv")
    said(driver, "gripper_T_camera is known to")
    row = choose(driver, 4)
    press(driver, "Leave out")
    until(driver, f"{row}.className.includes('out')")
    press(driver, "Finish and report")
    result = page.session.folder.path / "result" / "result.json"
    WebDriverWait(driver, 60).until(lambda _: result.exists() and (result.parent / "report.html").exists())
    WebDriverWait(driver, 60).until(lambda _: (DOWNLOADS[0] / "report.html").exists())
    assert 2 + driver.execute_script("return window.clicks") == 5  # a file dialog does not open here: two more
    assert time.monotonic() - started < 60.0
    files = [page.session.folder.path / f"{side}.csv" for side in ("robot", "camera")]
    again = uq.calibrate(uq.read_poses(*files), exclude=[4])
    np.testing.assert_array_equal(uq.load(result).X, again.X)
    assert errors(driver) == [] and capfd.readouterr().err == ""
    urls = set()
    for entry in driver.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] in ("Network.requestWillBeSent", "Network.webSocketCreated"):
            urls.add(message["params"].get("url") or message["params"]["request"]["url"])
    address = page.url.partition("/?")[0]
    here = (address, address.replace("http", "ws"), "data:", "blob:", "chrome:", "about:")
    assert [url for url in urls if not url.startswith(here)] == []
    assert page.url + COARSE in urls


def test_each_button_and_a_second_browser(driver, page, tmp_path):
    poses = uq.simulate(n_poses=16, noise=NOISE, seed=6)
    camera = np.array(poses.camera)
    camera[5, :3, 3] += 0.02
    uq.calibrate(poses.rows(np.arange(8, 16)), noise=NOISE).save(tmp_path / "stored.json")
    driver.get(page.url + COARSE)
    said(driver, "No poses yet")
    for k in range(8):
        page.session.add(poses.robot[k], camera[k])
        until(
            driver, "(document.getElementById('uq-answer') || {dataset: {}}).dataset.poses == arguments[0]", str(k + 1)
        )
    said(driver, "outliers 1 of 8 poses rejected: 5")
    row = choose(driver, 5)
    until(driver, "document.body.innerText.includes('from where the others predict it')")
    for label, out in (("Leave out", True), ("Take back", False), ("Undo", True)):
        press(driver, label)
        until(driver, f"{row}.className.includes(' out') == {str(out).lower()}")
    press(driver, "Drop last")
    said(driver, "6 poses.")
    opened = "[...document.querySelectorAll('*')].filter(e => e.innerText?.trim().startsWith('More: pictures')).pop()"
    driver.execute_script(f"{opened}.click()")
    upload(driver, "Compare with a result", tmp_path / "stored.json")
    until(driver, "document.body.innerText.includes('UNCHANGED: 6 new poses agree')")
    upload(driver, "Add a picture of the board", tmp_path / "stored.json")
    said(driver, "expected a picture")
    driver.switch_to.new_window("tab")
    driver.get(page.url + COARSE)
    said(driver, "6 poses.")
    driver.close()
    driver.switch_to.window(driver.window_handles[0])
    assert errors(driver) == []


def test_a_phone_in_the_dark_shows_the_panel_first(driver, page):
    poses = uq.simulate(n_poses=6, noise=NOISE, seed=7)
    for k in range(6):
        page.session.add(poses.robot[k], poses.camera[k], ask=k == 5)
    size = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        driver.get(page.url + COARSE + "&darkMode")
        said(driver, "6 poses")
        until(driver, "document.getElementById('uq-answer').getBoundingClientRect().top < 500")  # it slides in
        box = driver.execute_script("const b = document.getElementById('uq-answer').getBoundingClientRect();"
                                    "return [b.left, b.right]")  # fmt: skip
        assert box[0] >= 0 and 340 < box[1] - box[0] <= 390 and box[1] <= 390
        assert driver.execute_script("return document.documentElement.scrollWidth") <= 390
        assert driver.execute_script("return document.documentElement.dataset.mantineColorScheme") == "dark"
    finally:
        driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert errors(driver) == []


@pytest.mark.parametrize("kind", ["one camera", "a rig"])
def test_stored_results_are_drawn(driver, kind):
    if kind == "a rig":
        rig, _ = simulate_rig({"left": "arm", "cell": "world"}, {"board": "world", "tag": "arm"}, n_poses=10, seed=1,
                              seen=[("left", "board"), ("cell", "tag")])  # fmt: skip
        result = uq.calibrate(rig, noise=dict.fromkeys(("arm", "left", "cell"), ("1mrad", "1mm")))
        texts = ["gripper_T_left", "world_T_cell", "Robot pose 0. Ellipsoids"]
    else:
        result = uq.calibrate(uq.simulate(n_poses=10, noise=NOISE, seed=8), noise=NOISE)
        texts = ["gripper_T_camera is known to", "Point in the base", "Seen from pose 9"]
    shown = view_page(result, port=0)
    try:
        driver.get(shown.url + COARSE)
        for text in texts:
            until(driver, "document.body.innerText.includes(arguments[0])", text)
        until(driver, "document.querySelectorAll('canvas').length > 0")
        assert errors(driver) == []
    finally:
        leave(driver, shown)
