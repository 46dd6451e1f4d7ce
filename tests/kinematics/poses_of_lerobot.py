"""Joint values of an SO-101 as LeRobot writes them, and the poses that its kinematics gives, stored. Run by hand:

    pip install --no-deps lerobot==0.4.4
    pip install placo==0.10.2 numpy pyserial deepdiff tqdm draccus huggingface_hub packaging
    python tests/kinematics/poses_of_lerobot.py SO-ARM100/Simulation/SO101/so101_new_calib.urdf

The values are those of LeRobot's own `FeetechMotorsBus._normalize` at whole ticks; the poses are those of placo, which
LeRobot's `RobotKinematics` calls, at the angles before they are rounded. Modules that only training needs are left out.
"""

import json
import sys
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np

MOTORS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
RANGES = ((760, 3410), (822, 3190), (869, 3080), (905, 3230), (0, 4095), (2032, 3501))
CENTRE, SPREAD = (5.0, -20.0, 25.0, 40.0, 10.0, 30.0), (35.0, 30.0, 30.0, 35.0, 60.0, 20.0)


def main(urdf):
    for name in ("torch", "accelerate", "datasets", "datasets.utils", "datasets.utils.logging", "scservo_sdk"):
        sys.modules[name] = MagicMock()
    import placo
    from lerobot.motors import Motor, MotorCalibration, MotorNormMode
    from lerobot.motors.feetech import FeetechMotorsBus

    calibration = {name: MotorCalibration(k + 1, 0, 0, *RANGES[k]) for k, name in enumerate(MOTORS)}
    rng = np.random.default_rng(20261127)
    angles = np.array(CENTRE) + rng.uniform(-1, 1, (20, 6)) * SPREAD
    middle = np.mean(RANGES, axis=1)
    ticks = np.round(middle + angles * 4095 / 360).astype(int)

    def written(mode):
        bus = FeetechMotorsBus.__new__(FeetechMotorsBus)
        bus.motors = {name: Motor(k + 1, "sts3215", mode) for k, name in enumerate(MOTORS)}
        bus.motors["gripper"] = Motor(6, "sts3215", MotorNormMode.RANGE_0_100)
        bus.calibration = calibration
        bus._id_to_model_dict = {k + 1: "sts3215" for k in range(6)}
        bus._id_to_name_dict = {k + 1: name for k, name in enumerate(MOTORS)}
        return [list(bus._normalize({k + 1: int(row[k]) for k in range(6)}).values()) for row in ticks]

    robot = placo.RobotWrapper(urdf, placo.Flags.ignore_collisions)
    poses = []
    for row in np.radians(angles[:, :5]):
        for name, value in zip(MOTORS, row, strict=False):
            robot.set_joint(name, value)
        robot.update_kinematics()
        poses.append(np.round(robot.get_T_world_frame("gripper_frame_link")[:3], 8).tolist())
    stored = {
        "lerobot": "0.4.4",
        "placo": "0.10.2",
        "calibration": {name: vars(one) for name, one in calibration.items()},
        "shares": np.round(written(MotorNormMode.RANGE_M100_100), 5).tolist(),
        "degrees": np.round(written(MotorNormMode.DEGREES), 5).tolist(),
        "poses": poses,
    }
    Path(__file__).with_suffix(".json").write_text(json.dumps(stored) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1])
