"""Command ``demo``: the calibration of an embedded data set."""

from dataclasses import replace
from pathlib import Path

from ...errors import InputError
from ..delivery import REPORTS, DemoOutputs, deliver_result
from ..messages import LOG, quiet
from ..values import require_writable

# The demo writes this report if no other one is requested.
DEMO_REPORT = Path("demo_report.html")


def demo_command(outputs: DemoOutputs) -> int:
    """Calibrate an embedded data set whose true X is known.

    Examples:
      uq-handeye demo
      # Also write result.json, exports and figures
      uq-handeye demo --report demo.html -o demo/ --figures

    The noise of the poses is estimated, as it is of your own. Prints the
    estimate, compares it with the true X, and writes the report,
    demo_report.html unless --report names another file.
    """
    from importlib import resources

    from ...calibration.calibrate import calibrate
    from ...calibration.report.text import against_truth
    from ...read import read_pose_file, read_poses

    outputs.require_possible()
    if outputs.report is None and not outputs.as_json and not quiet():
        try:
            require_writable(DEMO_REPORT, "--report", REPORTS)
            outputs = replace(outputs, report=DEMO_REPORT)
        except InputError as error:
            LOG.warning("No report is written here. %s", error)
    with resources.as_file(resources.files("uq_handeye") / "data") as data:
        poses = read_poses(data / "robot.csv", data / "camera.csv")
        _, truth = read_pose_file(data / "truth.csv")
    result = calibrate(poses)
    return deliver_result(result, outputs, None, more=against_truth(result, truth[0]))
