"""Types of MuJoCo 4.0, made with pybind11-stubgen and shortened by hand."""

from typing import Any, overload

import numpy as np
import numpy.typing as npt
from mujoco._fields import F32Field, Float, FloatField, I32Field, Int, IntField
from mujoco._structs import MjModel, MjrRect, MjvFigure, MjvScene

class MjrContext:
    @overload
    def __init__(self) -> None: ...
    @overload
    def __init__(self, arg0: MjModel, arg1: Int, /) -> None: ...
    def free(self) -> None: ...
    @property
    def auxColor(self) -> npt.NDArray[np.uint32]: ...
    @auxColor.setter
    def auxColor(self, value: Any, /) -> None: ...
    @property
    def auxColor_r(self) -> npt.NDArray[np.uint32]: ...
    @auxColor_r.setter
    def auxColor_r(self, value: Any, /) -> None: ...
    @property
    def auxFBO(self) -> npt.NDArray[np.uint32]: ...
    @auxFBO.setter
    def auxFBO(self, value: Any, /) -> None: ...
    @property
    def auxFBO_r(self) -> npt.NDArray[np.uint32]: ...
    @auxFBO_r.setter
    def auxFBO_r(self, value: Any, /) -> None: ...
    auxHeight: I32Field
    auxSamples: I32Field
    auxWidth: I32Field
    baseBuiltin: IntField
    baseFontBig: IntField
    baseFontNormal: IntField
    baseFontShadow: IntField
    baseHField: IntField
    baseMesh: IntField
    basePlane: IntField
    charHeight: IntField
    charHeightBig: IntField
    charWidth: I32Field
    charWidthBig: I32Field
    currentBuffer: IntField
    fogEnd: FloatField
    fogRGBA: F32Field
    fogStart: FloatField
    fontScale: IntField
    glInitialized: IntField
    lineWidth: FloatField
    mat_texid: I32Field
    mat_texrepeat: F32Field
    mat_texuniform: I32Field
    @property
    def nskin(self) -> int: ...
    ntexture: IntField
    offColor: IntField
    offColor_r: IntField
    offDepthStencil: IntField
    offDepthStencil_r: IntField
    offFBO: IntField
    offFBO_r: IntField
    offHeight: IntField
    offSamples: IntField
    offWidth: IntField
    rangeBuiltin: IntField
    rangeFont: IntField
    rangeHField: IntField
    rangeMesh: IntField
    rangePlane: IntField
    readDepthMap: IntField
    readPixelFormat: IntField
    shadowClip: FloatField
    shadowFBO: IntField
    shadowScale: FloatField
    shadowSize: IntField
    shadowTex: IntField
    @property
    def skinfaceVBO(self) -> tuple[Any, ...]: ...
    @property
    def skinnormalVBO(self) -> tuple[Any, ...]: ...
    @property
    def skintexcoordVBO(self) -> tuple[Any, ...]: ...
    @property
    def skinvertVBO(self) -> tuple[Any, ...]: ...
    @property
    def texture(self) -> npt.NDArray[np.uint32]: ...
    @texture.setter
    def texture(self, value: Any, /) -> None: ...
    textureType: I32Field
    windowAvailable: IntField
    windowDoublebuffer: IntField
    windowSamples: IntField
    windowStereo: IntField

class MjrRendererInfo:
    def __init__(self) -> None: ...
    @property
    def backend(self) -> str: ...
    @property
    def renderer(self) -> str: ...

def mjr_addAux(index: Int, width: Int, height: Int, samples: Int, con: MjrContext) -> None: ...
def mjr_blitAux(index: Int, src: MjrRect, left: Int, bottom: Int, con: MjrContext) -> None: ...
def mjr_blitBuffer(
    src: MjrRect, dst: MjrRect, flg_color: Int, flg_depth: Int, con: MjrContext
) -> None: ...
def mjr_changeFont(fontscale: Int, con: MjrContext) -> None: ...
def mjr_defaultRendererInfo(info: MjrRendererInfo) -> None: ...
def mjr_drawPixels(
    rgb: npt.ArrayLike | None, depth: npt.ArrayLike | None, viewport: MjrRect, con: MjrContext
) -> None: ...
def mjr_figure(viewport: MjrRect, fig: MjvFigure, con: MjrContext) -> None: ...
def mjr_findRect(x: Int, y: Int, nrect: Int, rect: MjrRect) -> int: ...
def mjr_finish() -> None: ...
def mjr_getError() -> int: ...
def mjr_getRendererInfo(info: MjrRendererInfo) -> None: ...
def mjr_label(
    viewport: MjrRect,
    font: Int,
    txt: str,
    r: Float,
    g: Float,
    b: Float,
    a: Float,
    rt: Float,
    gt: Float,
    bt: Float,
    con: MjrContext,
) -> None: ...
def mjr_maxViewport(con: MjrContext) -> MjrRect: ...
def mjr_overlay(
    font: Int, gridpos: Int, viewport: MjrRect, overlay: str, overlay2: str, con: MjrContext
) -> None: ...
def mjr_readPixels(
    rgb: npt.NDArray[np.uint8] | None,
    depth: npt.NDArray[np.float32] | None,
    viewport: MjrRect,
    con: MjrContext,
) -> None: ...
def mjr_rectangle(viewport: MjrRect, r: Float, g: Float, b: Float, a: Float) -> None: ...
def mjr_render(viewport: MjrRect, scn: MjvScene, con: MjrContext) -> None: ...
def mjr_resizeOffscreen(width: Int, height: Int, con: MjrContext) -> None: ...
def mjr_restoreBuffer(con: MjrContext) -> None: ...
def mjr_setAux(index: Int, con: MjrContext) -> None: ...
def mjr_setBuffer(framebuffer: Int, con: MjrContext) -> None: ...
def mjr_text(
    font: Int, txt: str, con: MjrContext, x: Float, y: Float, r: Float, g: Float, b: Float
) -> None: ...
def mjr_uploadHField(m: MjModel, con: MjrContext, hfieldid: Int) -> None: ...
def mjr_uploadMesh(m: MjModel, con: MjrContext, meshid: Int) -> None: ...
def mjr_uploadTexture(m: MjModel, con: MjrContext, texid: Int) -> None: ...
