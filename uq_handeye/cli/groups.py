"""Groups of options in the help: their names, their order, and the options of each that the short help shows."""

ARGUMENTS = "Arguments"
PICTURES = "Pictures of a board"
POSE_FILES = "Pose files"
VIEWS = "Camera poses from other programs"
JOINTS = "Robot joints"
CAMERA_MODEL = "Camera model"
NOISE = "Noise"
SHARED = "Shared errors"
PRIOR = "Prior knowledge"
ESTIMATION = "Estimation"
OPTIONS = "Options"  # of options that name no group
OUTPUT = "Output"
MESSAGES = "Messages"

# Order in the help; a command's own groups stand where OPTIONS does.
_BEFORE = (ARGUMENTS, PICTURES, POSE_FILES, VIEWS, JOINTS, CAMERA_MODEL, NOISE, SHARED, PRIOR, ESTIMATION)
_AFTER = (OUTPUT, MESSAGES)

# Groups that the short help shows under the heading of another one, to save lines.
SHOWN_UNDER = {VIEWS: PICTURES, JOINTS: POSE_FILES, SHARED: NOISE, MESSAGES: OUTPUT}


class Group(str):
    """Name of a group of options; ``common`` if the short help shows the option that bears it."""

    common = False


def common_in(group: str | None) -> Group:
    """Return ``group`` as that of an option that the short help shows."""
    marked = Group(group or OPTIONS)
    marked.common = True
    return marked


def position(group: str) -> int:
    """Return the place of a group in the order of the help."""
    if group in _AFTER:
        return len(_BEFORE) + 1 + _AFTER.index(group)
    return _BEFORE.index(group) if group in _BEFORE else len(_BEFORE)
