"""Reading of poses, joints and camera files, and pairing of robot and camera poses."""

from ..core.files.atomic import write_atomically, write_files
from ..core.files.json_files import json_text
from ..formats.csv_poses import pose_text, read_pose_file, write_pose_file
from ..formats.detect import FORMATS
from ..formats.priors import read_prior
from ..model.errors.noise_toml import read_noise_file
from ..model.shared_errors.shared_toml import read_shared_errors
from .poses import read_poses, read_stream

__all__ = [
    "FORMATS",
    "json_text",
    "pose_text",
    "read_noise_file",
    "read_pose_file",
    "read_poses",
    "read_prior",
    "read_shared_errors",
    "read_stream",
    "write_atomically",
    "write_files",
    "write_pose_file",
]
