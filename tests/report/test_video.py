"""Video: as many frames as the run is long, and one clear message where nothing can draw."""

import os
import subprocess
import sys
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from robo47_qp.errors import MissingExtraError, RecordingError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.report.video import OffscreenCamera, Video
from robo47_qp.sim.simulation import Simulation
from tests.runs import Reach, make_runner

SCRIPT = Path(__file__).resolve().parents[2] / "scenarios" / "pickplace.py"
encoder = pytest.mark.skipif(
    find_spec("imageio_ffmpeg") is None or find_spec("imageio") is None,
    reason="imageio-ffmpeg is not installed: pip install '.[video]'",
)


@cache
def why_nothing_is_drawn() -> str | None:
    """Tried in a process of its own: a broken OpenGL can end a process."""
    draw = (
        "import mujoco; from robo47_qp.report.video import OffscreenCamera\n"
        "spec = mujoco.MjSpec(); spec.worldbody.add_camera(name='c'); m = spec.compile()\n"
        "d = mujoco.MjData(m); mujoco.mj_forward(m, d); OffscreenCamera(m, 'c', 64, 64).picture(d)"
    )
    done = subprocess.run([sys.executable, "-c", draw], capture_output=True, text=True, check=False)
    return None if done.returncode == 0 else done.stderr.strip().splitlines()[-1]


@pytest.fixture
def opengl() -> None:
    if why_nothing_is_drawn() is not None:
        pytest.skip(f"this machine cannot draw: {why_nothing_is_drawn()}")


def decoded(path: Path) -> NDArray[np.uint8]:
    """All frames (N, 720, 1280, 3)."""
    ffmpeg: Any = import_module("imageio_ffmpeg")
    told = subprocess.run(
        [ffmpeg.get_ffmpeg_exe(), "-i", str(path)], capture_output=True, text=True, check=False
    )
    assert "1280x720" in told.stderr
    assert " 30 fps" in told.stderr
    raw = subprocess.run(
        [ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"],
        capture_output=True,
        check=True,
    )
    return np.frombuffer(raw.stdout, dtype=np.uint8).reshape(-1, 720, 1280, 3)


@encoder
def test_a_video_has_thirty_different_frames_a_second(opengl: None, tmp_path: Path) -> None:
    path = tmp_path / "run.mp4"
    runner, simulation = make_runner(Reach(rise=0.004))
    video = Video(simulation, path)
    try:
        run = runner.run(observers=[video])
    finally:
        video.close()
    frames = decoded(path)
    assert len(frames) == pytest.approx(30 * len(run.rows) * 1e-3, abs=1.0)
    assert frames[0].std() > 10.0
    middle = frames[len(frames) // 2].astype(float)
    assert np.abs(frames[0] - middle).max() > 20.0


@encoder
def test_a_place_that_cannot_be_written_to_is_told(opengl: None, tmp_path: Path) -> None:
    simulation = Simulation(PANDA, Reach().build_scene)
    with pytest.raises(RecordingError, match=r"The video .*run\.foo cannot be written"):
        Video(simulation, tmp_path / "run.foo")


def test_a_missing_encoder_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match=r"--video needs the package .*\[video\]"):
        Video(Simulation(PANDA, Reach().build_scene), tmp_path / "run.mp4")


@encoder
@pytest.mark.skipif(sys.platform != "linux", reason="the packages are those of Linux")
def test_without_opengl_the_command_names_the_packages(tmp_path: Path) -> None:
    last = [tmp_path / name for name in ("run.rrd", "run.json", "run.mp4")]
    for path in last:
        path.write_text("the last one")
    hidden = ("DISPLAY", "WAYLAND_DISPLAY")
    environment = {k: v for k, v in os.environ.items() if k not in hidden}
    files = ["--log", str(tmp_path / "run.rrd"), "--video", str(tmp_path / "run.mp4")]
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *files],
        env={**environment, "MUJOCO_GL": "glfw", "COLUMNS": "1000"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 2
    assert done.stderr.count("error:") == 1
    assert "Traceback" not in done.stderr
    for word in ("libegl1", "libgl1", "libosmesa6", "MUJOCO_GL=egl"):
        assert word in done.stderr
    # What an earlier run left is still there.
    assert sorted(tmp_path.iterdir()) == sorted(last)
    assert all(path.read_text() == "the last one" for path in last)


def test_a_scene_without_its_camera_is_seen_as_a_whole(opengl: None) -> None:
    spec = mujoco.MjSpec()
    spec.worldbody.add_light(pos=[0.0, 0.0, 3.0])
    ball = mujoco.mjtGeom.mjGEOM_SPHERE
    spec.worldbody.add_geom(type=ball, size=[0.3, 0.0, 0.0], rgba=[1.0, 0.0, 0.0, 1.0])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = OffscreenCamera(model, "overview", 64, 64)
    try:
        red, green, _ = camera.picture(data).reshape(-1, 3).max(axis=0)
    finally:
        camera.close()
    assert red > 100 > green
