"""Work that needs more memory than is free is refused before it begins."""

import pytest

import uq_handeye as uq
from uq_handeye.core import memory


def test_free_memory_is_below_the_limit_of_the_control_group(tmp_path, monkeypatch):
    (tmp_path / "meminfo").write_text("MemTotal: 8000000 kB\nMemAvailable:    2000000 kB\n")
    monkeypatch.setattr(memory, "_MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(memory, "_CGROUP", tmp_path)
    assert memory.free_bytes() == 2_048_000_000
    for name, value in (("memory.max", "900000000"), ("memory.current", "400000000")):
        (tmp_path / name).write_text(f"{value}\n")
    assert memory.free_bytes() == 500_000_000
    (tmp_path / "memory.max").write_text("max\n")
    assert memory.free_bytes() == 2_048_000_000


def test_a_rig_beyond_the_free_memory_is_refused_in_one_line(monkeypatch):
    noise = {"left": ("1mrad", "0.5mm"), "right": ("1mrad", "0.5mm"), "arm": ("0.3mrad", "0.2mm")}
    rig, _ = uq.simulate_rig({"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=12, seed=0, noise=noise)
    monkeypatch.setattr(memory, "free_bytes", lambda: 100_000)
    with pytest.raises(
        uq.InputError, match=r"A rig of 24 views needs about .* GB of memory, and 0\.0001 GB are free"
    ) as found:
        uq.calibrate(rig)
    assert "\n" not in str(found.value)


def test_one_camera_is_refused_before_the_fit(monkeypatch):
    poses = uq.simulate(n_poses=10, seed=1, noise=uq.PoseNoise.isotropic(robot=("1mrad", "1mm")))
    monkeypatch.setattr(memory, "free_bytes", lambda: 50_000)
    with pytest.raises(uq.InputError, match=r"A fit to 10 poses needs about .* GB of memory"):
        uq.calibrate(uq.PosePairs(poses.robot, poses.camera))
    with pytest.raises(uq.InputError, match=r"every second row"):
        uq.calibrate(poses, noise=uq.PoseNoise.isotropic(camera=("1mrad", "1mm")))
    assert uq.calibrate(poses, method="park").X.shape == (4, 4)
