"""Names that options take and the shell completes: methods, formats, frames, classes of robots, units.

Nothing heavy is imported here, so that help and completion load quickly: the names are those of registries of other
packages, and a test compares them.
"""

from ..core.files.about import ABOUT

# Methods at the bound (`likelihood.ESTIMATORS`), published ones, and those of robot-world calibration.
AT_THE_BOUND = ("efficient", "ml")
PUBLISHED = (
    *("tsai", "shiu", "chou", "park", "horaud", "daniilidis", "andreff", "lu"),
    *("gwak", "heller", "condurache", "zhang", "zhao", "nguyen", "4dpa"),
)
ROBOT_WORLD = ("li", "shah")
EVERY_METHOD = (*AT_THE_BOUND, *PUBLISHED, *ROBOT_WORLD)
SETUP_NAMES = ("eye-in-hand", "eye-to-hand")
COVARIANCE_NAMES = ("model", "sandwich", "bootstrap")
CONTROLLER_NAMES = (
    *("ur", "kuka", "fanuc", "abb", "staubli", "yaskawa", "kawasaki", "mitsubishi", "denso", "epson", "doosan"),
    *("comau", "techman", "dobot", "jaka", "nachi", "adept", "mecademic", "xarm", "rpy"),
)
FORMAT_NAMES = (
    *("csv", "tum", "npz", "npy", "mat", "easy_handeye", "easy_handeye2", "moveit", "opencv", "json"),
    *("tf-echo", "ros-topic", "franka", "zivid", "halcon", "matrix"),
    *CONTROLLER_NAMES,
    "table",
)
# Names of core.geometry.conventions.CONVENTIONS.
CONVENTION_NAMES = (
    *("toolkit", "ros", "napa", "se3-right", "gtsam", "small-gicp", "manif", "sophus", "jaxlie", "g2o", "se3-left"),
    *("open3d", "pytransform3d", "pypose", "symforce", "calibsense", "opencv", "pycolmap", "factorama", "mrpt"),
    "paper",
)
ROBOT_FRAMES = ("base_T_gripper", "gripper_T_base")
CAMERA_FRAMES = ("camera_T_target", "target_T_camera")
CAMERA_CONVENTIONS = ("optical", "opengl", "ros", "wpilib")
PAIRINGS = ("rows", "time", "async")
PAPERS = ("a4", "letter")
TITLES = tuple(ABOUT)
UNITS = ("m", "mm", "cm", "um", "in")
JOINT_UNITS = ("rad", "deg")
# Those of kinematics.kinematic_errors and of error_terms.sizes.
ROBOT_CLASSES = ("industrial", "cobot", "hobby", "calibrated")
ACCURACY_CLASSES = ("calibrated", "industrial", "cobot")
EVERY_CLASS = tuple(dict.fromkeys((*ACCURACY_CLASSES, *ROBOT_CLASSES)))
