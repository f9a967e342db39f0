"""Pictures and videos of a simulation, rendered offscreen."""

import os
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from robo47_qp.errors import MissingExtraError, RecordingError, RenderingError
from robo47_qp.run.observers import Observer
from robo47_qp.sim.simulation import Simulation

_WIDTH, _HEIGHT, _FRAMES_PER_SECOND = 1280, 720, 30


class OffscreenCamera:
    """Renders pictures of a simulation."""

    def __init__(self, model: mujoco.MjModel, camera: str, width: int, height: int) -> None:
        """Open an offscreen context for a named camera, with a picture size [pixel].

        Where the scene has no camera of this name, it is seen as a whole.

        Raises:
            RenderingError: OpenGL does not work on this machine.
        """
        known = {model.camera(i).name for i in range(model.ncam)}
        # MuJoCo's own camera, which looks at the middle of a model from outside, has the number -1.
        self._camera: str | int = camera if camera in known else -1
        model.vis.global_.offwidth = max(width, model.vis.global_.offwidth)
        model.vis.global_.offheight = max(height, model.vis.global_.offheight)
        try:
            _use_egl_without_display()
            self._renderer = mujoco.Renderer(model, height, width)
        except (ImportError, AttributeError, OSError, RuntimeError, mujoco.FatalError) as error:
            raise RenderingError(
                f"OpenGL cannot draw offscreen here ({error}). On Debian or Ubuntu, install "
                "libegl1 and libgl1 and set MUJOCO_GL=egl, or install libosmesa6 and set "
                "MUJOCO_GL=osmesa. Everything but pictures works without."
            ) from error

    def picture(self, data: mujoco.MjData) -> NDArray[np.uint8]:
        """Return an RGB picture of shape (height, width, 3)."""
        self._renderer.update_scene(data, self._camera)
        return self._renderer.render().copy()

    def close(self) -> None:
        """Close the context."""
        self._renderer.close()


class Video(Observer):
    """Writes an mp4 of a run at 30 frames per simulated second."""

    def __init__(self, simulation: Simulation, path: Path) -> None:
        """Open camera and file.

        Raises:
            MissingExtraError: The encoder is not installed.
            RenderingError: See `OffscreenCamera`.
            RecordingError: The file cannot be written.
        """
        try:
            imageio: Any = import_module("imageio.v2")
            import_module("imageio_ffmpeg")
        except ImportError as error:
            raise MissingExtraError("--video", "imageio-ffmpeg", "video") from error
        self._path, self._frames = path, 0
        # Shadows would take three quarters of the time: 8 instead of 34 frames a second.
        simulation.model.vis.quality.shadowsize = 0
        self._camera = OffscreenCamera(simulation.model, "overview", _WIDTH, _HEIGHT)
        try:
            self._writer = imageio.get_writer(
                path, format="FFMPEG", fps=_FRAMES_PER_SECOND, macro_block_size=8
            )
        except (OSError, RuntimeError, ValueError) as error:
            self._camera.close()
            raise RecordingError(
                f"The video {path} cannot be written: {error}. Name an mp4 file in a folder "
                "that you may write to."
            ) from error

    def tick(self, simulation: Simulation) -> None:
        """Render the frames that are due."""
        while self._frames <= simulation.time * _FRAMES_PER_SECOND:
            try:
                self._writer.append_data(self._camera.picture(simulation.data))
            except OSError as error:
                reason = f"The video {self._path} could not be written: {error}."
                raise RecordingError(reason) from error
            self._frames += 1

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()
        self._camera.close()


def _use_egl_without_display() -> None:
    """Let MuJoCo render with EGL if there is no display and MUJOCO_GL is not set."""
    if sys.platform != "linux" or "MUJOCO_GL" in os.environ or os.environ.get("DISPLAY"):
        return
    context: Any = import_module("mujoco.rendering.classic.gl_context")
    context.GLContext = import_module("mujoco.egl").GLContext
