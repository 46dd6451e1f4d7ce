"""The page in a real browser, headless Chromium with software WebGL: slow pictures, so few tests that wait for what
is said."""

import json
import shutil

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.live_session.folder import Folder
from uq_handeye.live_session.session import Session
from uq_handeye.presentation import pdf

pytest.importorskip("viser", reason="viser (extra live) is not installed")
webdriver = pytest.importorskip("selenium.webdriver", reason="selenium (extra test) is not installed")
WebDriverWait = pytest.importorskip("selenium.webdriver.support.ui").WebDriverWait
from uq_handeye.live_session.page import Page  # noqa: E402

CHROMIUM, DRIVER = pdf.found_browser(), shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None, reason="needs Chromium and chromedriver (Debian: chromium, chromium-driver)"
)
FLAGS = [flag for flag in pdf.FLAGS if flag != "--disable-gpu"]
SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
COARSE = "?fixedDpr=0.2"  # fewer pixels to draw
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (*FLAGS, *SOFTWARE, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    options.add_experimental_option("prefs", {"download.default_directory": str(tmp_path_factory.mktemp("down"))})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    browser = webdriver.Chrome(options=options, service=Service(DRIVER))
    browser.set_window_size(700, 500)
    yield browser
    browser.quit()


@pytest.fixture
def page(tmp_path):
    shown = Page(Session(Folder(tmp_path / "session")), port=0)
    yield shown
    shown.close()


def until(driver, question, *given):
    """Wait until the page answers a question with something true, and return it."""
    return WebDriverWait(driver, 60, 0.1).until(lambda d: d.execute_script(f"return {question}", *given))


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


def test_two_files_one_pose_left_out_and_the_report(driver, page, tmp_path):
    """The path of a first-time user: five clicks; and nothing is asked of another machine."""
    poses = uq.simulate(n_poses=12, noise=NOISE, seed=5)
    for side in ("robot", "camera"):
        uq.io.write_pose_file(tmp_path / f"my <b>{side}.csv", getattr(poses, side))
    driver.get(page.url + COARSE)
    said(driver, "No poses yet")
    upload(driver, "Add robot poses", tmp_path / "my <b>robot.csv")
    upload(driver, "Add camera poses", tmp_path / "my <b>camera.csv")
    said(driver, "gripper_T_camera is known to")
    row = "document.querySelector('#uq-poses tr[data-pose=\"4\"]')"
    until(driver, f"!!{row}")
    driver.execute_script(f"{row}.click()")
    until(driver, f"{row}.className.includes('chosen')")
    press(driver, "Leave out")
    until(driver, f"{row}.className.includes('out')")
    press(driver, "Finish and report")
    result = page.session.folder.path / "result" / "result.json"
    WebDriverWait(driver, 60).until(lambda _: result.exists() and (result.parent / "report.html").exists())
    files = [page.session.folder.path / f"{side}.csv" for side in ("robot", "camera")]
    again = uq.calibrate(uq.read_poses(*files), exclude=[4])
    np.testing.assert_array_equal(uq.load(result).X, again.X)
    assert [entry for entry in driver.get_log("browser") if entry["level"] == "SEVERE"] == []
    urls = set()
    for entry in driver.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] in ("Network.requestWillBeSent", "Network.webSocketCreated"):
            urls.add(message["params"].get("url") or message["params"]["request"]["url"])
    here = (page.url, page.url.replace("http", "ws"), "data:", "blob:", "chrome:", "about:")
    assert [url for url in urls if not url.startswith((*here, page.url[:-1].replace("http", "ws")))] == []


def test_poses_come_one_by_one_and_two_browsers_see_them(driver, page):
    poses = uq.simulate(n_poses=5, noise=NOISE, seed=6)
    camera = np.array(poses.camera)
    driver.get(page.url + COARSE)
    said(driver, "No poses yet")
    for k in range(5):
        page.session.add(poses.robot[k], camera[k])
        until(
            driver, "(document.getElementById('uq-answer') || {dataset: {}}).dataset.poses == arguments[0]", str(k + 1)
        )
    said(driver, "from ")
    driver.switch_to.new_window("tab")
    driver.get(page.url + COARSE)
    said(driver, "5 poses")
    driver.close()
    driver.switch_to.window(driver.window_handles[0])
