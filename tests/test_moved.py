"""Earlier places of packages."""

import subprocess
import sys

import pytest

from uq_handeye._moved import PLACES

TRIED = """
import warnings
warnings.simplefilter("error")
import uq_handeye as uq
from uq_handeye.{new} import {file} as new
warnings.simplefilter("ignore")
from uq_handeye.{old} import {file} as old
assert old is new and new.__spec__.name == new.__name__ == "uq_handeye.{new}.{file}"
"""
FILES = {"io": "readings", "camera": "board", "one_model": "engine"}


@pytest.mark.parametrize("old", FILES)
def test_a_file_by_its_earlier_place_is_the_same_module(old):
    code = TRIED.format(old=old, new=PLACES[old], file=FILES[old])
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_earlier_place_is_said_to_have_moved():
    code = "import uq_handeye.kinematics.chain"
    done = subprocess.run(
        [sys.executable, "-W", "error::DeprecationWarning", "-c", code], capture_output=True, text=True
    )
    assert done.returncode == 1
    assert "uq_handeye.kinematics is now uq_handeye.model.kinematics." in done.stderr
