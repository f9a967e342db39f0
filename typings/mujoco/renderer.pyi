"""Offscreen renderer of MuJoCo 4.0."""

from types import TracebackType
from typing import Any, Self

import numpy.typing as npt
from mujoco._enums import mjtFontScale
from mujoco._structs import MjData, MjModel, MjvCamera, MjvOption, MjvScene

class Renderer:
    def __init__(
        self,
        model: MjModel,
        height: int = 240,
        width: int = 320,
        max_geom: int = 10000,
        font_scale: mjtFontScale = ...,
    ) -> None: ...
    @property
    def model(self) -> MjModel: ...
    @property
    def scene(self) -> MjvScene: ...
    @property
    def height(self) -> int: ...
    @property
    def width(self) -> int: ...
    def enable_depth_rendering(self) -> None: ...
    def disable_depth_rendering(self) -> None: ...
    def enable_segmentation_rendering(self) -> None: ...
    def disable_segmentation_rendering(self) -> None: ...
    # uint8 (height, width, 3), float32 (height, width) for depth, int32 (height, width, 2) for
    # segmentation
    def render(self, *, out: npt.NDArray[Any] | None = None) -> npt.NDArray[Any]: ...
    def update_scene(
        self,
        data: MjData,
        camera: int | str | MjvCamera = -1,
        scene_option: MjvOption | None = None,
    ) -> None: ...
    def close(self) -> None: ...
    def __enter__(self) -> Self: ...
    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc_value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None: ...
