"""Types of MuJoCo 4.0, made with pybind11-stubgen and shortened by hand."""

from typing import IO, TypeAlias

import numpy as np
from mujoco import _enums as _enums
from mujoco import _functions as _functions
from mujoco import _specs as _specs
from mujoco import _structs as _structs
from mujoco._callbacks import *
from mujoco._constants import *
from mujoco._enums import *
from mujoco._errors import *
from mujoco._functions import *
from mujoco._render import *
from mujoco._specs import *
from mujoco._structs import *
from mujoco.renderer import Renderer as Renderer

MjStruct: TypeAlias = _specs.Element
MJTNUM_DTYPE: type[np.float64]
HEADERS_DIR: str
PLUGINS_DIR: str
__version__: str

class GLContext:
    def __init__(self, max_width: int, max_height: int) -> None: ...
    def make_current(self) -> None: ...
    def free(self) -> None: ...

def to_zip(spec: _specs.MjSpec, file: str | IO[bytes]) -> None: ...
def from_zip(file: str | IO[bytes]) -> _specs.MjSpec: ...
