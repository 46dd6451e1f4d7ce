"""Keys of the errors that the program knows."""

from __future__ import annotations

from .key import ErrorKey, Kind, Owner

FOCAL_LENGTH = ErrorKey(Owner.CAMERA, Kind.FOCAL_LENGTH)
PRINCIPAL_POINT = ErrorKey(Owner.CAMERA, Kind.PRINCIPAL_POINT)
LENS = ErrorKey(Owner.CAMERA, Kind.LENS)
OUTLINE = ErrorKey(Owner.CAMERA, Kind.OUTLINE)
VIEW = ErrorKey(Owner.CAMERA, Kind.VIEW)
INTRINSICS = ErrorKey(Owner.CAMERA, Kind.INTRINSICS)
# Scale of camera poses that have none of their own, with a flat prior.
CAMERA_SCALE = ErrorKey(Owner.CAMERA, Kind.SCALE)
TARGET_SCALE = ErrorKey(Owner.TARGET, Kind.SCALE)
ROBOT_SCALE = ErrorKey(Owner.ROBOT, Kind.SCALE)
CLOCK_OFFSET = ErrorKey(Owner.ROBOT, Kind.CLOCK_OFFSET)
ROBOT_ACCURACY = ErrorKey(Owner.ROBOT, Kind.ACCURACY)
ROBOT_SHARED = ErrorKey(Owner.ROBOT, Kind.SHARED)
CAMERA_SHARED = ErrorKey(Owner.CAMERA, Kind.SHARED)
# Drifts, by what moves.
DRIFTS = {
    Owner.CAMERA: ErrorKey(Owner.SESSION, Kind.CAMERA_DRIFT),
    Owner.TARGET: ErrorKey(Owner.SESSION, Kind.TARGET_DRIFT),
}
# Random walk of camera poses from odometry.
WALKS = {
    kind: ErrorKey(Owner.SESSION, kind)
    for kind in (Kind.WALK_IN_ROTATION, Kind.WALK_IN_TRANSLATION, Kind.WALK_IN_SCALE)
}
# Errors of an arm's kinematics, in the order of its numbers.
ARM = tuple(
    ErrorKey(Owner.ROBOT, kind) for kind in (Kind.OFFSETS, Kind.TILTS, Kind.LENGTHS, Kind.TRANSMISSION, Kind.SAG)
)
JOINT_NOISE = ErrorKey(Owner.ROBOT, Kind.JOINT_NOISE)
ROBOT_ROTATION = ErrorKey(Owner.ROBOT, Kind.ROTATION)
ROBOT_TRANSLATION = ErrorKey(Owner.ROBOT, Kind.TRANSLATION)
CAMERA_ROTATION = ErrorKey(Owner.CAMERA, Kind.ROTATION)
CAMERA_TRANSLATION = ErrorKey(Owner.CAMERA, Kind.TRANSLATION)
# Of the camera poses along the viewing direction, in addition to that of all axes.
DEPTH = ErrorKey(Owner.CAMERA, Kind.DEPTH)
BY_VIEW = ErrorKey(Owner.CAMERA, Kind.BY_VIEW)
PIXELS = ErrorKey(Owner.CAMERA, Kind.PIXELS)
# Errors that the corners of a picture share: what residuals indicate if the robot is known.
CAMERA_EXCESS = ErrorKey(Owner.CAMERA, Kind.BEYOND_CORNERS)
# Camera poses from pictures of a scene: errors that they share, and those beyond what their features say.
SCENE_FEATURES = ErrorKey(Owner.CAMERA, Kind.FEATURES)
SCENE_EXCESS = ErrorKey(Owner.CAMERA, Kind.BEYOND_FEATURES)
PICTURE_SHIFT = ErrorKey(Owner.CAMERA, Kind.PICTURE_SHIFT)
# All noise of a side, as it was given.
GIVEN = {owner: ErrorKey(owner, Kind.GIVEN) for owner in (Owner.ROBOT, Owner.CAMERA)}
SIZES_OPEN = ErrorKey(Owner.ALL, Kind.SIZES_OPEN)
MOTION = ErrorKey(Owner.SESSION, Kind.MOTION)
