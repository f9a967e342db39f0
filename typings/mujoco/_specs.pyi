"""Types of MuJoCo 4.0, made with pybind11-stubgen and shortened by hand."""

from collections.abc import Iterator, Mapping, Sequence
from typing import IO, Any, TypeAlias, overload

import numpy.typing as npt
from mujoco import _structs
from mujoco._enums import (
    mjtActuator,
    mjtAlignFree,
    mjtBias,
    mjtBuiltin,
    mjtCamLight,
    mjtColorSpace,
    mjtConflict,
    mjtDataType,
    mjtDyn,
    mjtEmbed,
    mjtEq,
    mjtFlexSection,
    mjtFlexSelf,
    mjtGain,
    mjtGeom,
    mjtGeomInertia,
    mjtInertiaFromGeom,
    mjtJoint,
    mjtLightType,
    mjtLimited,
    mjtMark,
    mjtMeshInertia,
    mjtObj,
    mjtOrientation,
    mjtPassthrough,
    mjtProjection,
    mjtScaling,
    mjtSensor,
    mjtSleepPolicy,
    mjtStage,
    mjtTexture,
    mjtTrn,
    mjtWrap,
)
from mujoco._fields import (
    F64,
    F32Field,
    F64Field,
    Float,
    FloatField,
    I32Field,
    Int,
    IntField,
)
from mujoco._structs import MjData, MjLROpt, MjModel

__all__ = [
    "MjSpec",
    "MjsElement",
    "MjsDefault",
    "MjsBody",
    "MjsFrame",
    "MjsGeom",
    "MjsJoint",
    "MjsLight",
    "MjsMaterial",
    "MjsSite",
    "MjsMesh",
    "MjsSkin",
    "MjsTexture",
    "MjsText",
    "MjsTuple",
    "MjsCamera",
    "MjsFlex",
    "MjsHField",
    "MjsKey",
    "MjsNumeric",
    "MjsPair",
    "MjsExclude",
    "MjsEquality",
    "MjsTendon",
    "MjsSensor",
    "MjsActuator",
    "MjsPlugin",
    "MjsOrientation",
    "MjsWrap",
    "MjVisualHeadlight",
    "MjVisualRgba",
    "MjsCompiler",
    "MjsAuthored",
    "MjCharVec",
    "MjStringVec",
    "MjByteVec",
    "MjDoubleVec",
    "MjFloatVec",
    "MjIntVec",
    "MjVfs",
    "MjsTendonPath",
]

Element: TypeAlias = (
    MjsBody
    | MjsFrame
    | MjsGeom
    | MjsJoint
    | MjsLight
    | MjsMaterial
    | MjsSite
    | MjsMesh
    | MjsSkin
    | MjsTexture
    | MjsText
    | MjsTuple
    | MjsCamera
    | MjsFlex
    | MjsHField
    | MjsKey
    | MjsNumeric
    | MjsPair
    | MjsExclude
    | MjsEquality
    | MjsTendon
    | MjsSensor
    | MjsActuator
    | MjsPlugin
)

class MjSpec:
    assets: dict[Any, Any]
    authored: MjsAuthored
    comment: str
    compiler: MjsCompiler
    hasImplicitPluginElem: bool
    meshdir: str
    modelfiledir: str
    modelname: str
    option: MjOption
    override_assets: bool
    stat: MjStatistic
    strippath: bool
    texturedir: str
    visual: MjVisual
    @staticmethod
    def from_file(
        filename: str,
        include: Mapping[str, bytes] | None = None,
        assets: dict[Any, Any] | None = None,
        vfs: MjVfs | None = None,
    ) -> MjSpec: ...
    @staticmethod
    def from_string(
        xml: str,
        include: Mapping[str, bytes] | None = None,
        assets: dict[Any, Any] | None = None,
        vfs: MjVfs | None = None,
    ) -> MjSpec: ...
    @staticmethod
    def from_zip(file: str | IO[bytes]) -> MjSpec: ...
    @staticmethod
    def resolve_orientation(
        degree: bool, orientation: MjsOrientation, sequence: MjCharVec | None = None
    ) -> list[float]: ...
    def to_zip(self, file: str | IO[bytes]) -> None: ...
    def __init__(self) -> None: ...
    def activate_plugin(self, name: str) -> None: ...
    def actuator(self, arg0: str, /) -> MjsActuator | None: ...
    def add_actuator(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        type: Int | None = None,
        gaintype: Int | None = None,
        gainprm: npt.ArrayLike | None = None,
        biastype: Int | None = None,
        biasprm: npt.ArrayLike | None = None,
        dyntype: Int | None = None,
        dynprm: npt.ArrayLike | None = None,
        actdim: Int | None = None,
        ctrlspec: Int | None = None,
        velrange: npt.ArrayLike | None = None,
        ffrange: npt.ArrayLike | None = None,
        actearly: Int | None = None,
        trntype: Int | None = None,
        gear: npt.ArrayLike | None = None,
        target: str | None = None,
        refsite: str | None = None,
        slidersite: str | None = None,
        cranklength: Float | None = None,
        lengthrange: npt.ArrayLike | None = None,
        inheritrange: Float | None = None,
        damping: Any | None = None,
        armature: Float | None = None,
        ctrllimited: Int | None = None,
        ctrlrange: npt.ArrayLike | None = None,
        forcelimited: Int | None = None,
        forcerange: npt.ArrayLike | None = None,
        actlimited: Int | None = None,
        actrange: npt.ArrayLike | None = None,
        group: Int | None = None,
        nsample: Int | None = None,
        interp: Int | None = None,
        delay: Float | None = None,
        userdata: npt.ArrayLike | None = None,
        plugin: MjsPlugin | None = None,
        info: str | None = None,
    ) -> MjsActuator: ...
    def add_default(self, arg0: str, arg1: MjsDefault, /) -> MjsDefault: ...
    def add_equality(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        type: Int | None = None,
        data: npt.ArrayLike | None = None,
        active: Int | None = None,
        name1: str | None = None,
        name2: str | None = None,
        objtype: Int | None = None,
        solref: npt.ArrayLike | None = None,
        solimp: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsEquality: ...
    def add_exclude(
        self,
        name: str | None = None,
        bodyname1: str | None = None,
        bodyname2: str | None = None,
        info: str | None = None,
    ) -> MjsExclude: ...
    def add_flex(
        self,
        name: str | None = None,
        contype: Int | None = None,
        conaffinity: Int | None = None,
        condim: Int | None = None,
        priority: Int | None = None,
        friction: npt.ArrayLike | None = None,
        solmix: Float | None = None,
        solref: npt.ArrayLike | None = None,
        solimp: npt.ArrayLike | None = None,
        margin: Float | None = None,
        gap: Float | None = None,
        dim: Int | None = None,
        radius: Float | None = None,
        size: Any | None = None,
        flatskin: Int | None = None,
        selfcollide: Int | None = None,
        passive: Int | None = None,
        activelayers: Int | None = None,
        group: Int | None = None,
        edgestiffness: Float | None = None,
        edgedamping: Float | None = None,
        rgba: npt.ArrayLike | None = None,
        material: Sequence[str] | None = None,
        young: Float | None = None,
        poisson: Float | None = None,
        shear: Float | None = None,
        damping: Float | None = None,
        thickness: Float | None = None,
        stressyield: npt.ArrayLike | None = None,
        elastic2d: Int | None = None,
        elastic3d: Int | None = None,
        section: Int | None = None,
        sectionsize: npt.ArrayLike | None = None,
        cellcount: npt.ArrayLike | None = None,
        order: Int | None = None,
        nodebody: Sequence[str] | None = None,
        vertbody: Sequence[str] | None = None,
        node: npt.ArrayLike | None = None,
        vert: npt.ArrayLike | None = None,
        elem: npt.ArrayLike | None = None,
        texcoord: npt.ArrayLike | None = None,
        elemtexcoord: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsFlex: ...
    def add_hfield(
        self,
        name: str | None = None,
        content_type: str | None = None,
        file: str | None = None,
        size: npt.ArrayLike | None = None,
        nrow: Int | None = None,
        ncol: Int | None = None,
        userdata: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsHField: ...
    def add_key(
        self,
        name: str | None = None,
        time: Float | None = None,
        qpos: npt.ArrayLike | None = None,
        qvel: npt.ArrayLike | None = None,
        act: npt.ArrayLike | None = None,
        mpos: npt.ArrayLike | None = None,
        mquat: npt.ArrayLike | None = None,
        ctrl: npt.ArrayLike | None = None,
        plastic: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsKey: ...
    def add_material(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        textures: Sequence[str] | None = None,
        texuniform: Int | None = None,
        texrepeat: npt.ArrayLike | None = None,
        emission: Float | None = None,
        specular: Float | None = None,
        shininess: Float | None = None,
        reflectance: Float | None = None,
        metallic: Float | None = None,
        roughness: Float | None = None,
        rgba: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsMaterial: ...
    def add_mesh(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        content_type: str | None = None,
        file: str | None = None,
        refpos: npt.ArrayLike | None = None,
        refquat: npt.ArrayLike | None = None,
        scale: npt.ArrayLike | None = None,
        inertia: Int | None = None,
        smoothnormal: Int | None = None,
        needsdf: Int | None = None,
        maxhullvert: Int | None = None,
        uservert: npt.ArrayLike | None = None,
        usernormal: npt.ArrayLike | None = None,
        usertexcoord: npt.ArrayLike | None = None,
        userface: npt.ArrayLike | None = None,
        userfacenormal: npt.ArrayLike | None = None,
        userfacetexcoord: npt.ArrayLike | None = None,
        usernode: npt.ArrayLike | None = None,
        usertet: npt.ArrayLike | None = None,
        plugin: MjsPlugin | None = None,
        material: str | None = None,
        octree_maxdepth: Int | None = None,
        info: str | None = None,
    ) -> MjsMesh: ...
    def add_numeric(
        self,
        name: str | None = None,
        data: npt.ArrayLike | None = None,
        size: Int | None = None,
        info: str | None = None,
    ) -> MjsNumeric: ...
    def add_pair(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        geomname1: str | None = None,
        geomname2: str | None = None,
        condim: Int | None = None,
        solref: npt.ArrayLike | None = None,
        solreffriction: npt.ArrayLike | None = None,
        solimp: npt.ArrayLike | None = None,
        margin: Float | None = None,
        gap: Float | None = None,
        adhesion: Float | None = None,
        friction: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsPair: ...
    def add_plugin(
        self,
        name: str | None = None,
        plugin_name: str | None = None,
        active: Int | None = None,
        info: str | None = None,
    ) -> MjsPlugin: ...
    def add_sensor(
        self,
        name: str | None = None,
        type: Int | None = None,
        objtype: Int | None = None,
        objname: str | None = None,
        reftype: Int | None = None,
        refname: str | None = None,
        intprm: npt.ArrayLike | None = None,
        datatype: Int | None = None,
        needstage: Int | None = None,
        dim: Int | None = None,
        cutoff: Float | None = None,
        noise: Float | None = None,
        nsample: Int | None = None,
        interp: Int | None = None,
        delay: Float | None = None,
        interval: npt.ArrayLike | None = None,
        userdata: npt.ArrayLike | None = None,
        plugin: MjsPlugin | None = None,
        info: str | None = None,
    ) -> MjsSensor: ...
    def add_skin(
        self,
        name: str | None = None,
        file: str | None = None,
        material: str | None = None,
        rgba: npt.ArrayLike | None = None,
        inflate: Float | None = None,
        group: Int | None = None,
        vert: npt.ArrayLike | None = None,
        texcoord: npt.ArrayLike | None = None,
        face: npt.ArrayLike | None = None,
        bodyname: Sequence[str] | None = None,
        bindpos: npt.ArrayLike | None = None,
        bindquat: npt.ArrayLike | None = None,
        vertid: Sequence[npt.ArrayLike] | None = None,
        vertweight: Sequence[npt.ArrayLike] | None = None,
        info: str | None = None,
    ) -> MjsSkin: ...
    def add_tendon(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        stiffness: Any | None = None,
        springlength: npt.ArrayLike | None = None,
        springyield: Float | None = None,
        damping: Any | None = None,
        frictionloss: Float | None = None,
        solref_friction: npt.ArrayLike | None = None,
        solimp_friction: npt.ArrayLike | None = None,
        armature: Float | None = None,
        limited: Int | None = None,
        actfrclimited: Int | None = None,
        range: npt.ArrayLike | None = None,
        actfrcrange: npt.ArrayLike | None = None,
        margin: Float | None = None,
        solref_limit: npt.ArrayLike | None = None,
        solimp_limit: npt.ArrayLike | None = None,
        material: str | None = None,
        width: Float | None = None,
        rgba: npt.ArrayLike | None = None,
        group: Int | None = None,
        userdata: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsTendon: ...
    def add_text(
        self, name: str | None = None, data: str | None = None, info: str | None = None
    ) -> MjsText: ...
    def add_texture(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        type: Int | None = None,
        colorspace: Int | None = None,
        builtin: Int | None = None,
        mark: Int | None = None,
        rgb1: npt.ArrayLike | None = None,
        rgb2: npt.ArrayLike | None = None,
        markrgb: npt.ArrayLike | None = None,
        random: Float | None = None,
        height: Int | None = None,
        width: Int | None = None,
        nchannel: Int | None = None,
        content_type: str | None = None,
        file: str | None = None,
        gridsize: npt.ArrayLike | None = None,
        gridlayout: Any = None,
        cubefiles: Sequence[str] | None = None,
        data: npt.ArrayLike | None = None,
        hflip: Int | None = None,
        vflip: Int | None = None,
        embed: Int | None = None,
        info: str | None = None,
    ) -> MjsTexture: ...
    def add_tuple(
        self,
        name: str | None = None,
        objtype: npt.ArrayLike | None = None,
        objname: Sequence[str] | None = None,
        objprm: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsTuple: ...
    def adopt_inertial(self, body: MjsBody, vfs: MjVfs | None = None) -> None: ...
    def attach(
        self,
        child: MjSpec,
        prefix: str | None = None,
        suffix: str | None = None,
        site: Any | None = None,
        frame: Any | None = None,
    ) -> MjsFrame: ...
    def body(self, arg0: str, /) -> MjsBody | None: ...
    def camera(self, arg0: str, /) -> MjsCamera | None: ...
    def compile(self, vfs: MjVfs | None = None) -> MjModel: ...
    def copy(self) -> MjSpec: ...
    def copy_back(self, model: Any) -> None: ...
    def dedup_assets(self) -> int: ...
    def delete(self, element: Element | MjsDefault, /) -> None: ...
    def discard_visual(self, vfs: MjVfs | None = None) -> int: ...
    def encode(
        self, filename: str, model: Any | None = None, content_type: str | None = None
    ) -> int: ...
    def equality(self, arg0: str, /) -> MjsEquality | None: ...
    def exclude(self, arg0: str, /) -> MjsExclude | None: ...
    def find_default(self, arg0: str, /) -> MjsDefault | None: ...
    def flex(self, arg0: str, /) -> MjsFlex | None: ...
    def frame(self, arg0: str, /) -> MjsFrame | None: ...
    def fuse_static(self, vfs: MjVfs | None = None) -> int: ...
    def geom(self, arg0: str, /) -> MjsGeom | None: ...
    def hfield(self, arg0: str, /) -> MjsHField | None: ...
    def joint(self, arg0: str, /) -> MjsJoint | None: ...
    def key(self, arg0: str, /) -> MjsKey | None: ...
    def light(self, arg0: str, /) -> MjsLight | None: ...
    def material(self, arg0: str, /) -> MjsMaterial | None: ...
    def mesh(self, arg0: str, /) -> MjsMesh | None: ...
    def numeric(self, arg0: str, /) -> MjsNumeric | None: ...
    def pair(self, arg0: str, /) -> MjsPair | None: ...
    def plugin(self, arg0: str, /) -> MjsPlugin | None: ...
    def recompile(self, m: Any, d: Any, vfs: MjVfs | None = None) -> tuple[MjModel, MjData]: ...
    def sensor(self, arg0: str, /) -> MjsSensor | None: ...
    def site(self, arg0: str, /) -> MjsSite | None: ...
    def skin(self, arg0: str, /) -> MjsSkin | None: ...
    def tendon(self, arg0: str, /) -> MjsTendon | None: ...
    def text(self, arg0: str, /) -> MjsText | None: ...
    def texture(self, arg0: str, /) -> MjsTexture | None: ...
    def to_file(self, arg0: str, /) -> None: ...
    def to_xml(self) -> str: ...
    @property
    def actuators(self) -> list[MjsActuator]: ...
    @property
    def bodies(self) -> list[MjsBody]: ...
    @property
    def cameras(self) -> list[MjsCamera]: ...
    @property
    def copy_during_attach(self) -> int: ...
    @copy_during_attach.setter
    def copy_during_attach(self, value: bool, /) -> None: ...
    @property
    def default(self) -> MjsDefault: ...
    @property
    def equalities(self) -> list[MjsEquality]: ...
    @property
    def excludes(self) -> list[MjsExclude]: ...
    @property
    def flexes(self) -> list[MjsFlex]: ...
    @property
    def frames(self) -> list[MjsFrame]: ...
    @property
    def geoms(self) -> list[MjsGeom]: ...
    @property
    def hfields(self) -> list[MjsHField]: ...
    @property
    def joints(self) -> list[MjsJoint]: ...
    @property
    def keys(self) -> list[MjsKey]: ...
    @property
    def lights(self) -> list[MjsLight]: ...
    @property
    def materials(self) -> list[MjsMaterial]: ...
    memory: IntField
    @property
    def meshes(self) -> list[MjsMesh]: ...
    nconmax: IntField
    nemax: IntField
    njmax: IntField
    nkey: IntField
    nstack: IntField
    @property
    def numerics(self) -> list[MjsNumeric]: ...
    nuser_actuator: IntField
    nuser_body: IntField
    nuser_cam: IntField
    nuser_geom: IntField
    nuser_jnt: IntField
    nuser_sensor: IntField
    nuser_site: IntField
    nuser_tendon: IntField
    nuserdata: IntField
    @property
    def pairs(self) -> list[MjsPair]: ...
    @property
    def parent(self) -> MjSpec: ...
    @property
    def plugins(self) -> list[MjsPlugin]: ...
    @property
    def sensors(self) -> list[MjsSensor]: ...
    @property
    def sites(self) -> list[MjsSite]: ...
    @property
    def skins(self) -> list[MjsSkin]: ...
    @property
    def tendons(self) -> list[MjsTendon]: ...
    @property
    def texts(self) -> list[MjsText]: ...
    @property
    def textures(self) -> list[MjsTexture]: ...
    @property
    def timer(self) -> F64: ...
    @property
    def tuples(self) -> list[MjsTuple]: ...
    @property
    def worldbody(self) -> MjsBody: ...
    def tuple(self, arg0: str, /) -> MjsTuple | None: ...

class MjsElement: ...

class MjsDefault:
    actuator: MjsActuator
    camera: MjsCamera
    equality: MjsEquality
    flex: MjsFlex
    geom: MjsGeom
    joint: MjsJoint
    light: MjsLight
    material: MjsMaterial
    mesh: MjsMesh
    name: str
    pair: MjsPair
    site: MjsSite
    tendon: MjsTendon
    texture: MjsTexture

class MjsBody:
    alt: MjsOrientation
    childclass: str
    classname: MjsDefault
    explicitinertial: bool
    ialt: MjsOrientation
    info: str
    mocap: bool
    name: str
    plugin: MjsPlugin
    def add_body(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        childclass: str | None = None,
        pos: npt.ArrayLike | None = None,
        quat: npt.ArrayLike | None = None,
        axisangle: npt.ArrayLike | None = None,
        xyaxes: npt.ArrayLike | None = None,
        zaxis: npt.ArrayLike | None = None,
        euler: npt.ArrayLike | None = None,
        mass: Float | None = None,
        ipos: npt.ArrayLike | None = None,
        iquat: npt.ArrayLike | None = None,
        inertia: npt.ArrayLike | None = None,
        iaxisangle: npt.ArrayLike | None = None,
        ixyaxes: npt.ArrayLike | None = None,
        izaxis: npt.ArrayLike | None = None,
        ieuler: npt.ArrayLike | None = None,
        fullinertia: npt.ArrayLike | None = None,
        mocap: Int | None = None,
        gravcomp: Float | None = None,
        sleep: Int | None = None,
        simple: Int | None = None,
        fuse: Int | None = None,
        userdata: npt.ArrayLike | None = None,
        explicitinertial: Int | None = None,
        plugin: MjsPlugin | None = None,
        info: str | None = None,
    ) -> MjsBody: ...
    def add_camera(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        pos: npt.ArrayLike | None = None,
        quat: npt.ArrayLike | None = None,
        axisangle: npt.ArrayLike | None = None,
        xyaxes: npt.ArrayLike | None = None,
        zaxis: npt.ArrayLike | None = None,
        euler: npt.ArrayLike | None = None,
        mode: Int | None = None,
        targetbody: str | None = None,
        proj: Int | None = None,
        resolution: npt.ArrayLike | None = None,
        output: Int | None = None,
        fovy: Float | None = None,
        ipd: Float | None = None,
        intrinsic: npt.ArrayLike | None = None,
        sensor_size: npt.ArrayLike | None = None,
        focal_length: npt.ArrayLike | None = None,
        focal_pixel: npt.ArrayLike | None = None,
        principal_length: npt.ArrayLike | None = None,
        principal_pixel: npt.ArrayLike | None = None,
        userdata: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsCamera: ...
    def add_frame(
        self,
        default: MjsFrame | None = None,
        name: str | None = None,
        childclass: str | None = None,
        pos: npt.ArrayLike | None = None,
        quat: npt.ArrayLike | None = None,
        axisangle: npt.ArrayLike | None = None,
        xyaxes: npt.ArrayLike | None = None,
        zaxis: npt.ArrayLike | None = None,
        euler: npt.ArrayLike | None = None,
        scale: Any | None = None,
        scaling: Int | None = None,
        massscale: Float | None = None,
        info: str | None = None,
    ) -> MjsFrame: ...
    def add_freejoint(self, **kwargs: Any) -> MjsJoint: ...
    def add_geom(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        type: Int | None = None,
        pos: npt.ArrayLike | None = None,
        quat: npt.ArrayLike | None = None,
        axisangle: npt.ArrayLike | None = None,
        xyaxes: npt.ArrayLike | None = None,
        zaxis: npt.ArrayLike | None = None,
        euler: npt.ArrayLike | None = None,
        fromto: npt.ArrayLike | None = None,
        size: Any | None = None,
        contype: Int | None = None,
        conaffinity: Int | None = None,
        condim: Int | None = None,
        priority: Int | None = None,
        friction: npt.ArrayLike | None = None,
        solmix: Float | None = None,
        solref: npt.ArrayLike | None = None,
        solimp: npt.ArrayLike | None = None,
        margin: Float | None = None,
        gap: Float | None = None,
        surfacevel: npt.ArrayLike | None = None,
        adhesion: Float | None = None,
        mass: Float | None = None,
        density: Float | None = None,
        typeinertia: Int | None = None,
        fluid_ellipsoid: Int | None = None,
        fluid_coefs: npt.ArrayLike | None = None,
        material: str | None = None,
        rgba: npt.ArrayLike | None = None,
        group: Int | None = None,
        castshadow: Int | None = None,
        hfieldname: str | None = None,
        meshname: str | None = None,
        fitscale: Float | None = None,
        userdata: npt.ArrayLike | None = None,
        plugin: MjsPlugin | None = None,
        info: str | None = None,
    ) -> MjsGeom: ...
    def add_joint(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        type: Int | None = None,
        pos: npt.ArrayLike | None = None,
        axis: npt.ArrayLike | None = None,
        ref: Float | None = None,
        align: Int | None = None,
        stiffness: Any | None = None,
        springref: Float | None = None,
        springyield: Float | None = None,
        springdamper: npt.ArrayLike | None = None,
        limited: Int | None = None,
        range: npt.ArrayLike | None = None,
        margin: Float | None = None,
        solref_limit: npt.ArrayLike | None = None,
        solimp_limit: npt.ArrayLike | None = None,
        actfrclimited: Int | None = None,
        actfrcrange: npt.ArrayLike | None = None,
        armature: Float | None = None,
        damping: Any | None = None,
        frictionloss: Float | None = None,
        solref_friction: npt.ArrayLike | None = None,
        solimp_friction: npt.ArrayLike | None = None,
        group: Int | None = None,
        actgravcomp: Int | None = None,
        userdata: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsJoint: ...
    def add_light(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        pos: npt.ArrayLike | None = None,
        dir: npt.ArrayLike | None = None,
        mode: Int | None = None,
        targetbody: str | None = None,
        active: Int | None = None,
        type: Int | None = None,
        texture: str | None = None,
        castshadow: Int | None = None,
        bulbradius: Float | None = None,
        intensity: Float | None = None,
        range: Float | None = None,
        attenuation: npt.ArrayLike | None = None,
        cutoff: Float | None = None,
        softness: Float | None = None,
        exponent: Float | None = None,
        ambient: npt.ArrayLike | None = None,
        diffuse: npt.ArrayLike | None = None,
        specular: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsLight: ...
    def add_site(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        pos: npt.ArrayLike | None = None,
        quat: npt.ArrayLike | None = None,
        axisangle: npt.ArrayLike | None = None,
        xyaxes: npt.ArrayLike | None = None,
        zaxis: npt.ArrayLike | None = None,
        euler: npt.ArrayLike | None = None,
        fromto: npt.ArrayLike | None = None,
        size: Any | None = None,
        type: Int | None = None,
        material: str | None = None,
        group: Int | None = None,
        rgba: npt.ArrayLike | None = None,
        meshname: str | None = None,
        userdata: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsSite: ...
    def attach_frame(
        self, frame: MjsFrame, prefix: str | None = None, suffix: str | None = None
    ) -> MjsFrame: ...
    @overload
    def find_all(self, arg0: mjtObj, /) -> list[Any]: ...
    @overload
    def find_all(self, arg0: str, /) -> list[Any]: ...
    def find_child(self, arg0: str, /) -> MjsBody | None: ...
    def first_body(self) -> MjsBody | None: ...
    def first_camera(self) -> MjsCamera | None: ...
    def first_frame(self) -> MjsFrame | None: ...
    def first_geom(self) -> MjsGeom | None: ...
    def first_joint(self) -> MjsJoint | None: ...
    def first_light(self) -> MjsLight | None: ...
    def first_site(self) -> MjsSite | None: ...
    def make_flex(
        self,
        name: str,
        type: str | None = None,
        dim: Int = 3,
        dof: str | None = None,
        count: npt.ArrayLike | None = None,
        cellcount: npt.ArrayLike | None = None,
        spacing: npt.ArrayLike | None = None,
        scale: npt.ArrayLike | None = None,
        radius: Float = 0.0,
        mass: Float = 1.0,
        inertiabox: Float = 0.005,
        equality: Int = 0,
        rigid: Int = 0,
        flatskin: Int = 0,
        elastic2d: Int = 0,
        pos: npt.ArrayLike | None = None,
        quat: npt.ArrayLike | None = None,
        origin: npt.ArrayLike | None = None,
        file: str | None = None,
        mesh: str | None = None,
        vfs: MjVfs | None = None,
    ) -> MjsFlex: ...
    def next_body(self, arg0: MjsBody, /) -> MjsBody | None: ...
    def next_camera(self, arg0: MjsCamera, /) -> MjsCamera | None: ...
    def next_frame(self, arg0: MjsFrame, /) -> MjsFrame | None: ...
    def next_geom(self, arg0: MjsGeom, /) -> MjsGeom | None: ...
    def next_joint(self, arg0: MjsJoint, /) -> MjsJoint | None: ...
    def next_light(self, arg0: MjsLight, /) -> MjsLight | None: ...
    def next_site(self, arg0: MjsSite, /) -> MjsSite | None: ...
    def set_frame(self, arg0: MjsFrame, /) -> None: ...
    def to_frame(self) -> MjsFrame: ...
    @property
    def bodies(self) -> list[MjsBody]: ...
    @property
    def cameras(self) -> list[MjsCamera]: ...
    @property
    def compiler(self) -> MjsCompiler: ...
    @property
    def frame(self) -> MjsFrame: ...
    @property
    def frames(self) -> list[MjsFrame]: ...
    fullinertia: F64Field
    fuse: IntField
    @property
    def geoms(self) -> list[MjsGeom]: ...
    gravcomp: FloatField
    @property
    def id(self) -> int: ...
    inertia: F64Field
    ipos: F64Field
    iquat: F64Field
    @property
    def joints(self) -> list[MjsJoint]: ...
    @property
    def lights(self) -> list[MjsLight]: ...
    mass: FloatField
    @property
    def parent(self) -> MjsBody: ...
    pos: F64Field
    quat: F64Field
    @property
    def signature(self) -> int: ...
    simple: IntField
    @property
    def sites(self) -> list[MjsSite]: ...
    @property
    def sleep(self) -> mjtSleepPolicy: ...
    @sleep.setter
    def sleep(self, value: Int, /) -> None: ...
    @property
    def userdata(self) -> MjDoubleVec: ...
    @userdata.setter
    def userdata(self, value: Any, /) -> None: ...

class MjsFrame:
    alt: MjsOrientation
    childclass: str
    info: str
    name: str
    def add_body(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        childclass: str | None = None,
        pos: npt.ArrayLike | None = None,
        quat: npt.ArrayLike | None = None,
        axisangle: npt.ArrayLike | None = None,
        xyaxes: npt.ArrayLike | None = None,
        zaxis: npt.ArrayLike | None = None,
        euler: npt.ArrayLike | None = None,
        mass: Float | None = None,
        ipos: npt.ArrayLike | None = None,
        iquat: npt.ArrayLike | None = None,
        inertia: npt.ArrayLike | None = None,
        iaxisangle: npt.ArrayLike | None = None,
        ixyaxes: npt.ArrayLike | None = None,
        izaxis: npt.ArrayLike | None = None,
        ieuler: npt.ArrayLike | None = None,
        fullinertia: npt.ArrayLike | None = None,
        mocap: Int | None = None,
        gravcomp: Float | None = None,
        sleep: Int | None = None,
        simple: Int | None = None,
        fuse: Int | None = None,
        userdata: npt.ArrayLike | None = None,
        explicitinertial: Int | None = None,
        plugin: MjsPlugin | None = None,
        info: str | None = None,
    ) -> MjsBody: ...
    def add_camera(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        pos: npt.ArrayLike | None = None,
        quat: npt.ArrayLike | None = None,
        axisangle: npt.ArrayLike | None = None,
        xyaxes: npt.ArrayLike | None = None,
        zaxis: npt.ArrayLike | None = None,
        euler: npt.ArrayLike | None = None,
        mode: Int | None = None,
        targetbody: str | None = None,
        proj: Int | None = None,
        resolution: npt.ArrayLike | None = None,
        output: Int | None = None,
        fovy: Float | None = None,
        ipd: Float | None = None,
        intrinsic: npt.ArrayLike | None = None,
        sensor_size: npt.ArrayLike | None = None,
        focal_length: npt.ArrayLike | None = None,
        focal_pixel: npt.ArrayLike | None = None,
        principal_length: npt.ArrayLike | None = None,
        principal_pixel: npt.ArrayLike | None = None,
        userdata: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsCamera: ...
    def add_frame(
        self,
        default: MjsFrame | None = None,
        name: str | None = None,
        childclass: str | None = None,
        pos: npt.ArrayLike | None = None,
        quat: npt.ArrayLike | None = None,
        axisangle: npt.ArrayLike | None = None,
        xyaxes: npt.ArrayLike | None = None,
        zaxis: npt.ArrayLike | None = None,
        euler: npt.ArrayLike | None = None,
        scale: Any | None = None,
        scaling: Int | None = None,
        massscale: Float | None = None,
        info: str | None = None,
    ) -> MjsFrame: ...
    def add_geom(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        type: Int | None = None,
        pos: npt.ArrayLike | None = None,
        quat: npt.ArrayLike | None = None,
        axisangle: npt.ArrayLike | None = None,
        xyaxes: npt.ArrayLike | None = None,
        zaxis: npt.ArrayLike | None = None,
        euler: npt.ArrayLike | None = None,
        fromto: npt.ArrayLike | None = None,
        size: Any | None = None,
        contype: Int | None = None,
        conaffinity: Int | None = None,
        condim: Int | None = None,
        priority: Int | None = None,
        friction: npt.ArrayLike | None = None,
        solmix: Float | None = None,
        solref: npt.ArrayLike | None = None,
        solimp: npt.ArrayLike | None = None,
        margin: Float | None = None,
        gap: Float | None = None,
        surfacevel: npt.ArrayLike | None = None,
        adhesion: Float | None = None,
        mass: Float | None = None,
        density: Float | None = None,
        typeinertia: Int | None = None,
        fluid_ellipsoid: Int | None = None,
        fluid_coefs: npt.ArrayLike | None = None,
        material: str | None = None,
        rgba: npt.ArrayLike | None = None,
        group: Int | None = None,
        castshadow: Int | None = None,
        hfieldname: str | None = None,
        meshname: str | None = None,
        fitscale: Float | None = None,
        userdata: npt.ArrayLike | None = None,
        plugin: MjsPlugin | None = None,
        info: str | None = None,
    ) -> MjsGeom: ...
    def add_joint(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        type: Int | None = None,
        pos: npt.ArrayLike | None = None,
        axis: npt.ArrayLike | None = None,
        ref: Float | None = None,
        align: Int | None = None,
        stiffness: Any | None = None,
        springref: Float | None = None,
        springyield: Float | None = None,
        springdamper: npt.ArrayLike | None = None,
        limited: Int | None = None,
        range: npt.ArrayLike | None = None,
        margin: Float | None = None,
        solref_limit: npt.ArrayLike | None = None,
        solimp_limit: npt.ArrayLike | None = None,
        actfrclimited: Int | None = None,
        actfrcrange: npt.ArrayLike | None = None,
        armature: Float | None = None,
        damping: Any | None = None,
        frictionloss: Float | None = None,
        solref_friction: npt.ArrayLike | None = None,
        solimp_friction: npt.ArrayLike | None = None,
        group: Int | None = None,
        actgravcomp: Int | None = None,
        userdata: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsJoint: ...
    def add_light(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        pos: npt.ArrayLike | None = None,
        dir: npt.ArrayLike | None = None,
        mode: Int | None = None,
        targetbody: str | None = None,
        active: Int | None = None,
        type: Int | None = None,
        texture: str | None = None,
        castshadow: Int | None = None,
        bulbradius: Float | None = None,
        intensity: Float | None = None,
        range: Float | None = None,
        attenuation: npt.ArrayLike | None = None,
        cutoff: Float | None = None,
        softness: Float | None = None,
        exponent: Float | None = None,
        ambient: npt.ArrayLike | None = None,
        diffuse: npt.ArrayLike | None = None,
        specular: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsLight: ...
    def add_site(
        self,
        default: MjsDefault | None = None,
        name: str | None = None,
        pos: npt.ArrayLike | None = None,
        quat: npt.ArrayLike | None = None,
        axisangle: npt.ArrayLike | None = None,
        xyaxes: npt.ArrayLike | None = None,
        zaxis: npt.ArrayLike | None = None,
        euler: npt.ArrayLike | None = None,
        fromto: npt.ArrayLike | None = None,
        size: Any | None = None,
        type: Int | None = None,
        material: str | None = None,
        group: Int | None = None,
        rgba: npt.ArrayLike | None = None,
        meshname: str | None = None,
        userdata: npt.ArrayLike | None = None,
        info: str | None = None,
    ) -> MjsSite: ...
    def attach_body(
        self, body: MjsBody, prefix: str | None = None, suffix: str | None = None
    ) -> MjsBody: ...
    def set_frame(self, arg0: MjsFrame, /) -> None: ...
    @property
    def compiler(self) -> MjsCompiler: ...
    @property
    def frame(self) -> MjsFrame: ...
    @property
    def id(self) -> int: ...
    massscale: FloatField
    @property
    def parent(self) -> MjsBody: ...
    pos: F64Field
    quat: F64Field
    scale: F64Field
    @property
    def scaling(self) -> mjtScaling: ...
    @scaling.setter
    def scaling(self, value: Int, /) -> None: ...
    @property
    def signature(self) -> int: ...

class MjsGeom:
    alt: MjsOrientation
    castshadow: bool
    classname: MjsDefault
    hfieldname: str
    info: str
    material: str
    meshname: str
    name: str
    plugin: MjsPlugin
    def set_frame(self, arg0: MjsFrame, /) -> None: ...
    adhesion: FloatField
    @property
    def compiler(self) -> MjsCompiler: ...
    conaffinity: IntField
    condim: IntField
    contype: IntField
    density: FloatField
    fitscale: FloatField
    fluid_coefs: F64Field
    fluid_ellipsoid: FloatField
    @property
    def frame(self) -> MjsFrame: ...
    friction: F64Field
    fromto: F64Field
    gap: FloatField
    group: IntField
    @property
    def id(self) -> int: ...
    margin: FloatField
    mass: FloatField
    @property
    def parent(self) -> MjsBody: ...
    pos: F64Field
    priority: IntField
    quat: F64Field
    rgba: F32Field
    @property
    def signature(self) -> int: ...
    size: F64Field
    solimp: F64Field
    solmix: FloatField
    solref: F64Field
    surfacevel: F64Field
    @property
    def typeinertia(self) -> mjtGeomInertia: ...
    @typeinertia.setter
    def typeinertia(self, value: Int, /) -> None: ...
    @property
    def userdata(self) -> MjDoubleVec: ...
    @userdata.setter
    def userdata(self, value: Any, /) -> None: ...
    @property
    def type(self) -> mjtGeom: ...
    @type.setter
    def type(self, value: Int, /) -> None: ...

class MjsJoint:
    actgravcomp: bool
    classname: MjsDefault
    info: str
    name: str
    def set_frame(self, arg0: MjsFrame, /) -> None: ...
    @property
    def actfrclimited(self) -> mjtLimited: ...
    @actfrclimited.setter
    def actfrclimited(self, value: Int, /) -> None: ...
    actfrcrange: F64Field
    @property
    def align(self) -> mjtAlignFree: ...
    @align.setter
    def align(self, value: Int, /) -> None: ...
    armature: FloatField
    axis: F64Field
    @property
    def compiler(self) -> MjsCompiler: ...
    damping: F64Field
    @property
    def frame(self) -> MjsFrame: ...
    frictionloss: FloatField
    group: IntField
    @property
    def id(self) -> int: ...
    @property
    def limited(self) -> mjtLimited: ...
    @limited.setter
    def limited(self, value: Int, /) -> None: ...
    margin: FloatField
    @property
    def parent(self) -> MjsBody: ...
    pos: F64Field
    ref: FloatField
    @property
    def signature(self) -> int: ...
    solimp_friction: F64Field
    solimp_limit: F64Field
    solref_friction: F64Field
    solref_limit: F64Field
    springdamper: F64Field
    springref: FloatField
    springyield: FloatField
    stiffness: F64Field
    @property
    def userdata(self) -> MjDoubleVec: ...
    @userdata.setter
    def userdata(self, value: Any, /) -> None: ...
    range: F64Field
    @property
    def type(self) -> mjtJoint: ...
    @type.setter
    def type(self, value: Int, /) -> None: ...

class MjsLight:
    active: bool
    castshadow: bool
    classname: MjsDefault
    info: str
    name: str
    targetbody: str
    texture: str
    def set_frame(self, arg0: MjsFrame, /) -> None: ...
    ambient: F32Field
    attenuation: F32Field
    bulbradius: FloatField
    @property
    def compiler(self) -> MjsCompiler: ...
    cutoff: FloatField
    diffuse: F32Field
    dir: F64Field
    exponent: FloatField
    @property
    def frame(self) -> MjsFrame: ...
    @property
    def id(self) -> int: ...
    intensity: FloatField
    @property
    def mode(self) -> mjtCamLight: ...
    @mode.setter
    def mode(self, value: Int, /) -> None: ...
    @property
    def parent(self) -> MjsBody: ...
    pos: F64Field
    @property
    def signature(self) -> int: ...
    softness: FloatField
    specular: F32Field
    range: FloatField
    @property
    def type(self) -> mjtLightType: ...
    @type.setter
    def type(self, value: Int, /) -> None: ...

class MjsMaterial:
    classname: MjsDefault
    info: str
    name: str
    texuniform: bool
    @property
    def compiler(self) -> MjsCompiler: ...
    emission: FloatField
    @property
    def id(self) -> int: ...
    metallic: FloatField
    reflectance: FloatField
    rgba: F32Field
    roughness: FloatField
    shininess: FloatField
    @property
    def signature(self) -> int: ...
    specular: FloatField
    texrepeat: F32Field
    @property
    def textures(self) -> MjStringVec: ...
    @textures.setter
    def textures(self, value: Any, /) -> None: ...

class MjsSite:
    alt: MjsOrientation
    classname: MjsDefault
    info: str
    material: str
    meshname: str
    name: str
    def attach_body(
        self, body: MjsBody, prefix: str | None = None, suffix: str | None = None
    ) -> MjsBody: ...
    def set_frame(self, arg0: MjsFrame, /) -> None: ...
    @property
    def compiler(self) -> MjsCompiler: ...
    @property
    def frame(self) -> MjsFrame: ...
    fromto: F64Field
    group: IntField
    @property
    def id(self) -> int: ...
    @property
    def parent(self) -> MjsBody: ...
    pos: F64Field
    quat: F64Field
    rgba: F32Field
    @property
    def signature(self) -> int: ...
    size: F64Field
    @property
    def userdata(self) -> MjDoubleVec: ...
    @userdata.setter
    def userdata(self, value: Any, /) -> None: ...
    @property
    def type(self) -> mjtGeom: ...
    @type.setter
    def type(self, value: Int, /) -> None: ...

class MjsMesh:
    classname: MjsDefault
    content_type: str
    file: str
    info: str
    material: str
    name: str
    needsdf: bool
    plugin: MjsPlugin
    smoothnormal: bool
    def make_box(self, count: npt.ArrayLike, spacing: npt.ArrayLike, dim: Int = 3) -> None: ...
    def make_cone(self, nedge: Int, radius: Float) -> None: ...
    def make_cylinder(self, count: npt.ArrayLike, spacing: npt.ArrayLike, dim: Int = 3) -> None: ...
    def make_disc(self, count: npt.ArrayLike, spacing: npt.ArrayLike) -> None: ...
    def make_ellipsoid(
        self, count: npt.ArrayLike, spacing: npt.ArrayLike, dim: Int = 3
    ) -> None: ...
    def make_grid(self, count: npt.ArrayLike, spacing: npt.ArrayLike, dim: Int = 3) -> None: ...
    def make_hemisphere(self, resolution: Int) -> None: ...
    def make_plate(self, resolution: npt.ArrayLike = ...) -> None: ...
    def make_sphere(self, subdivision: Int) -> None: ...
    def make_square(self, count: npt.ArrayLike, spacing: npt.ArrayLike) -> None: ...
    def make_supersphere(self, resolution: Int, e: Float, n: Float) -> None: ...
    def make_supertorus(self, resolution: Int, radius: Float, s: Float, t: Float) -> None: ...
    def make_wedge(
        self, resolution: npt.ArrayLike = ..., fov: npt.ArrayLike = ..., gamma: Float = 0
    ) -> None: ...
    @property
    def compiler(self) -> MjsCompiler: ...
    @property
    def id(self) -> int: ...
    @property
    def inertia(self) -> mjtMeshInertia: ...
    @inertia.setter
    def inertia(self, value: Int, /) -> None: ...
    maxhullvert: IntField
    octree_maxdepth: IntField
    refpos: F64Field
    refquat: F64Field
    scale: F64Field
    @property
    def signature(self) -> int: ...
    @property
    def userface(self) -> MjIntVec: ...
    @userface.setter
    def userface(self, value: Any, /) -> None: ...
    @property
    def userfacenormal(self) -> MjIntVec: ...
    @userfacenormal.setter
    def userfacenormal(self, value: Any, /) -> None: ...
    @property
    def userfacetexcoord(self) -> MjIntVec: ...
    @userfacetexcoord.setter
    def userfacetexcoord(self, value: Any, /) -> None: ...
    @property
    def usernode(self) -> MjDoubleVec: ...
    @usernode.setter
    def usernode(self, value: Any, /) -> None: ...
    @property
    def usernormal(self) -> MjFloatVec: ...
    @usernormal.setter
    def usernormal(self, value: Any, /) -> None: ...
    @property
    def usertet(self) -> MjIntVec: ...
    @usertet.setter
    def usertet(self, value: Any, /) -> None: ...
    @property
    def usertexcoord(self) -> MjFloatVec: ...
    @usertexcoord.setter
    def usertexcoord(self, value: Any, /) -> None: ...
    @property
    def uservert(self) -> MjFloatVec: ...
    @uservert.setter
    def uservert(self, value: Any, /) -> None: ...

class MjsSkin:
    file: str
    info: str
    material: str
    name: str
    @property
    def bindpos(self) -> MjFloatVec: ...
    @bindpos.setter
    def bindpos(self, value: Any, /) -> None: ...
    @property
    def bindquat(self) -> MjFloatVec: ...
    @bindquat.setter
    def bindquat(self, value: Any, /) -> None: ...
    @property
    def bodyname(self) -> MjStringVec: ...
    @bodyname.setter
    def bodyname(self, value: Any, /) -> None: ...
    @property
    def compiler(self) -> MjsCompiler: ...
    @property
    def face(self) -> MjIntVec: ...
    @face.setter
    def face(self, value: Any, /) -> None: ...
    group: IntField
    @property
    def id(self) -> int: ...
    inflate: FloatField
    rgba: F32Field
    @property
    def signature(self) -> int: ...
    @property
    def texcoord(self) -> MjFloatVec: ...
    @texcoord.setter
    def texcoord(self, value: Any, /) -> None: ...
    @property
    def vert(self) -> MjFloatVec: ...
    @vert.setter
    def vert(self, value: Any, /) -> None: ...
    @property
    def vertid(self) -> list[Any]: ...
    @vertid.setter
    def vertid(self, value: Any, /) -> None: ...
    @property
    def vertweight(self) -> list[Any]: ...
    @vertweight.setter
    def vertweight(self, value: Any, /) -> None: ...

class MjsTexture:
    classname: MjsDefault
    content_type: str
    data: bytes
    file: str
    hflip: bool
    info: str
    name: str
    vflip: bool
    @property
    def builtin(self) -> mjtBuiltin: ...
    @builtin.setter
    def builtin(self, value: Int, /) -> None: ...
    @property
    def colorspace(self) -> mjtColorSpace: ...
    @colorspace.setter
    def colorspace(self, value: Int, /) -> None: ...
    @property
    def compiler(self) -> MjsCompiler: ...
    @property
    def cubefiles(self) -> MjStringVec: ...
    @cubefiles.setter
    def cubefiles(self, value: Any, /) -> None: ...
    @property
    def embed(self) -> mjtEmbed: ...
    @embed.setter
    def embed(self, value: Int, /) -> None: ...
    @property
    def gridlayout(self) -> MjCharVec: ...
    @gridlayout.setter
    def gridlayout(self, value: Any, /) -> None: ...
    gridsize: I32Field
    height: IntField
    @property
    def id(self) -> int: ...
    @property
    def mark(self) -> mjtMark: ...
    @mark.setter
    def mark(self, value: Int, /) -> None: ...
    markrgb: F64Field
    nchannel: IntField
    random: FloatField
    rgb1: F64Field
    rgb2: F64Field
    @property
    def signature(self) -> int: ...
    width: IntField
    @property
    def type(self) -> mjtTexture: ...
    @type.setter
    def type(self, value: Int, /) -> None: ...

class MjsText:
    data: str
    info: str
    name: str
    @property
    def compiler(self) -> MjsCompiler: ...
    @property
    def id(self) -> int: ...
    @property
    def signature(self) -> int: ...

class MjsTuple:
    info: str
    name: str
    @property
    def compiler(self) -> MjsCompiler: ...
    @property
    def id(self) -> int: ...
    @property
    def objname(self) -> MjStringVec: ...
    @objname.setter
    def objname(self, value: Any, /) -> None: ...
    @property
    def objprm(self) -> MjDoubleVec: ...
    @objprm.setter
    def objprm(self, value: Any, /) -> None: ...
    @property
    def objtype(self) -> MjIntVec: ...
    @objtype.setter
    def objtype(self, value: Any, /) -> None: ...
    @property
    def signature(self) -> int: ...

class MjsCamera:
    alt: MjsOrientation
    classname: MjsDefault
    info: str
    name: str
    targetbody: str
    def set_frame(self, arg0: MjsFrame, /) -> None: ...
    @property
    def compiler(self) -> MjsCompiler: ...
    focal_length: F32Field
    focal_pixel: F32Field
    fovy: FloatField
    @property
    def frame(self) -> MjsFrame: ...
    @property
    def id(self) -> int: ...
    intrinsic: F32Field
    ipd: FloatField
    @property
    def mode(self) -> mjtCamLight: ...
    @mode.setter
    def mode(self, value: Int, /) -> None: ...
    output: IntField
    @property
    def parent(self) -> MjsBody: ...
    pos: F64Field
    principal_length: F32Field
    principal_pixel: F32Field
    @property
    def proj(self) -> mjtProjection: ...
    @proj.setter
    def proj(self, value: Int, /) -> None: ...
    quat: F64Field
    resolution: I32Field
    sensor_size: F32Field
    @property
    def signature(self) -> int: ...
    @property
    def userdata(self) -> MjDoubleVec: ...
    @userdata.setter
    def userdata(self, value: Any, /) -> None: ...

class MjsFlex:
    flatskin: bool
    info: str
    name: str
    activelayers: IntField
    cellcount: I32Field
    @property
    def compiler(self) -> MjsCompiler: ...
    conaffinity: IntField
    condim: IntField
    contype: IntField
    damping: FloatField
    dim: IntField
    edgedamping: FloatField
    edgestiffness: FloatField
    elastic2d: IntField
    elastic3d: IntField
    @property
    def elem(self) -> MjIntVec: ...
    @elem.setter
    def elem(self, value: Any, /) -> None: ...
    @property
    def elemtexcoord(self) -> MjIntVec: ...
    @elemtexcoord.setter
    def elemtexcoord(self, value: Any, /) -> None: ...
    friction: F64Field
    gap: FloatField
    group: IntField
    @property
    def id(self) -> int: ...
    margin: FloatField
    @property
    def material(self) -> MjStringVec: ...
    @material.setter
    def material(self, value: Any, /) -> None: ...
    @property
    def node(self) -> MjDoubleVec: ...
    @node.setter
    def node(self, value: Any, /) -> None: ...
    @property
    def nodebody(self) -> MjStringVec: ...
    @nodebody.setter
    def nodebody(self, value: Any, /) -> None: ...
    order: IntField
    passive: IntField
    poisson: FloatField
    priority: IntField
    radius: FloatField
    rgba: F32Field
    @property
    def section(self) -> mjtFlexSection: ...
    @section.setter
    def section(self, value: Int, /) -> None: ...
    sectionsize: F64Field
    @property
    def selfcollide(self) -> mjtFlexSelf: ...
    @selfcollide.setter
    def selfcollide(self, value: Int, /) -> None: ...
    shear: FloatField
    @property
    def signature(self) -> int: ...
    size: F64Field
    solimp: F64Field
    solmix: FloatField
    solref: F64Field
    stressyield: F64Field
    @property
    def texcoord(self) -> MjFloatVec: ...
    @texcoord.setter
    def texcoord(self, value: Any, /) -> None: ...
    thickness: FloatField
    @property
    def vert(self) -> MjDoubleVec: ...
    @vert.setter
    def vert(self, value: Any, /) -> None: ...
    @property
    def vertbody(self) -> MjStringVec: ...
    @vertbody.setter
    def vertbody(self, value: Any, /) -> None: ...
    young: FloatField

class MjsHField:
    content_type: str
    file: str
    info: str
    name: str
    @property
    def compiler(self) -> MjsCompiler: ...
    @property
    def id(self) -> int: ...
    ncol: IntField
    nrow: IntField
    @property
    def signature(self) -> int: ...
    size: F64Field
    @property
    def userdata(self) -> MjFloatVec: ...
    @userdata.setter
    def userdata(self, value: Any, /) -> None: ...

class MjsKey:
    info: str
    name: str
    @property
    def act(self) -> MjDoubleVec: ...
    @act.setter
    def act(self, value: Any, /) -> None: ...
    @property
    def compiler(self) -> MjsCompiler: ...
    @property
    def ctrl(self) -> MjDoubleVec: ...
    @ctrl.setter
    def ctrl(self, value: Any, /) -> None: ...
    @property
    def id(self) -> int: ...
    @property
    def mpos(self) -> MjDoubleVec: ...
    @mpos.setter
    def mpos(self, value: Any, /) -> None: ...
    @property
    def mquat(self) -> MjDoubleVec: ...
    @mquat.setter
    def mquat(self, value: Any, /) -> None: ...
    @property
    def plastic(self) -> MjDoubleVec: ...
    @plastic.setter
    def plastic(self, value: Any, /) -> None: ...
    @property
    def qpos(self) -> MjDoubleVec: ...
    @qpos.setter
    def qpos(self, value: Any, /) -> None: ...
    @property
    def qvel(self) -> MjDoubleVec: ...
    @qvel.setter
    def qvel(self, value: Any, /) -> None: ...
    @property
    def signature(self) -> int: ...
    time: FloatField

class MjsNumeric:
    info: str
    name: str
    @property
    def compiler(self) -> MjsCompiler: ...
    @property
    def data(self) -> MjDoubleVec: ...
    @data.setter
    def data(self, value: Any, /) -> None: ...
    @property
    def id(self) -> int: ...
    @property
    def signature(self) -> int: ...
    size: IntField

class MjsPair:
    classname: MjsDefault
    geomname1: str
    geomname2: str
    info: str
    name: str
    adhesion: FloatField
    @property
    def compiler(self) -> MjsCompiler: ...
    condim: IntField
    friction: F64Field
    gap: FloatField
    @property
    def id(self) -> int: ...
    margin: FloatField
    @property
    def signature(self) -> int: ...
    solimp: F64Field
    solref: F64Field
    solreffriction: F64Field

class MjsExclude:
    bodyname1: str
    bodyname2: str
    info: str
    name: str
    @property
    def compiler(self) -> MjsCompiler: ...
    @property
    def id(self) -> int: ...
    @property
    def signature(self) -> int: ...

class MjsEquality:
    active: bool
    classname: MjsDefault
    info: str
    name: str
    name1: str
    name2: str
    @property
    def compiler(self) -> MjsCompiler: ...
    data: F64Field
    @property
    def id(self) -> int: ...
    @property
    def objtype(self) -> mjtObj: ...
    @objtype.setter
    def objtype(self, value: Int, /) -> None: ...
    @property
    def signature(self) -> int: ...
    solimp: F64Field
    solref: F64Field
    @property
    def type(self) -> mjtEq: ...
    @type.setter
    def type(self, value: Int, /) -> None: ...

class MjsTendon:
    info: str
    material: str
    name: str
    def default(self) -> MjsDefault: ...
    def wrap_geom(self, arg0: str, arg1: str, /) -> MjsWrap: ...
    def wrap_joint(self, arg0: str, arg1: Float, /) -> MjsWrap: ...
    def wrap_pulley(self, arg0: Float, /) -> MjsWrap: ...
    def wrap_site(self, arg0: str, /) -> MjsWrap: ...
    @property
    def actfrclimited(self) -> mjtLimited: ...
    @actfrclimited.setter
    def actfrclimited(self, value: Int, /) -> None: ...
    actfrcrange: F64Field
    armature: FloatField
    @property
    def compiler(self) -> MjsCompiler: ...
    damping: F64Field
    frictionloss: FloatField
    group: IntField
    @property
    def id(self) -> int: ...
    @property
    def limited(self) -> mjtLimited: ...
    @limited.setter
    def limited(self, value: Int, /) -> None: ...
    margin: FloatField
    @property
    def path(self) -> MjsTendonPath: ...
    rgba: F32Field
    @property
    def signature(self) -> int: ...
    solimp_friction: F64Field
    solimp_limit: F64Field
    solref_friction: F64Field
    solref_limit: F64Field
    springlength: F64Field
    springyield: FloatField
    stiffness: F64Field
    @property
    def userdata(self) -> MjDoubleVec: ...
    @userdata.setter
    def userdata(self, value: Any, /) -> None: ...
    width: FloatField
    range: F64Field

class MjsSensor:
    info: str
    name: str
    objname: str
    plugin: MjsPlugin
    refname: str
    def get_data_size(self) -> int: ...
    @property
    def compiler(self) -> MjsCompiler: ...
    cutoff: FloatField
    @property
    def datatype(self) -> mjtDataType: ...
    @datatype.setter
    def datatype(self, value: Int, /) -> None: ...
    delay: FloatField
    dim: IntField
    @property
    def id(self) -> int: ...
    interp: IntField
    interval: F64Field
    intprm: I32Field
    @property
    def needstage(self) -> mjtStage: ...
    @needstage.setter
    def needstage(self, value: Int, /) -> None: ...
    noise: FloatField
    nsample: IntField
    @property
    def objtype(self) -> mjtObj: ...
    @objtype.setter
    def objtype(self, value: Int, /) -> None: ...
    @property
    def reftype(self) -> mjtObj: ...
    @reftype.setter
    def reftype(self, value: Int, /) -> None: ...
    @property
    def signature(self) -> int: ...
    @property
    def userdata(self) -> MjDoubleVec: ...
    @userdata.setter
    def userdata(self, value: Any, /) -> None: ...
    @property
    def type(self) -> mjtSensor: ...
    @type.setter
    def type(self, value: Int, /) -> None: ...

class MjsActuator:
    actearly: bool
    classname: MjsDefault
    info: str
    name: str
    plugin: MjsPlugin
    refsite: str
    slidersite: str
    target: str
    def set_to_adhesion(self, gain: Float) -> None: ...
    def set_to_cylinder(
        self, timeconst: Float, bias: Float, area: Float, diameter: Float = -1
    ) -> None: ...
    def set_to_damper(self, kv: Float) -> None: ...
    def set_to_dcmotor(
        self,
        motorconst: npt.ArrayLike,
        resistance: Float,
        nominal: npt.ArrayLike = ...,
        saturation: npt.ArrayLike = ...,
        inductance: npt.ArrayLike = ...,
        cogging: npt.ArrayLike = ...,
        controller: npt.ArrayLike = ...,
        thermal: npt.ArrayLike = ...,
        lugre: npt.ArrayLike = ...,
        ctrlspec: Int = 0,
    ) -> None: ...
    def set_to_intvelocity(
        self,
        kp: Float,
        kv: Float = -1,
        dampratio: Float = -1,
        timeconst: Float = -1,
        inheritrange: bool = False,
    ) -> None: ...
    def set_to_motor(self) -> None: ...
    def set_to_muscle(
        self,
        timeconst: npt.ArrayLike = ...,
        tausmooth: Float = 0,
        range: npt.ArrayLike = ...,
        force: Float = -1,
        scale: Float = -1,
        lmin: Float = -1,
        lmax: Float = -1,
        vmax: Float = -1,
        fpmax: Float = -1,
        fvmax: Float = -1,
    ) -> None: ...
    def set_to_orientation(
        self, kp: Float, kv: Float = -1, dampratio: Float = -1, ctrlspec: Int = 0
    ) -> None: ...
    def set_to_pid(
        self,
        kp: Float,
        kv: Float = -1,
        dampratio: Float = -1,
        ki: Float = -1,
        imax: Float = -1,
        slewmax: Float = -1,
        inheritrange: Float = 0,
        ctrlspec: Int = 0,
    ) -> None: ...
    def set_to_position(
        self,
        kp: Float,
        kv: Float = -1,
        dampratio: Float = -1,
        timeconst: Float = -1,
        inheritrange: bool = False,
    ) -> None: ...
    def set_to_velocity(self, kv: Float) -> None: ...
    actdim: IntField
    @property
    def actlimited(self) -> mjtLimited: ...
    @actlimited.setter
    def actlimited(self, value: Int, /) -> None: ...
    actrange: F64Field
    armature: FloatField
    biasprm: F64Field
    @property
    def biastype(self) -> mjtBias: ...
    @biastype.setter
    def biastype(self, value: Int, /) -> None: ...
    @property
    def compiler(self) -> MjsCompiler: ...
    cranklength: FloatField
    @property
    def ctrllimited(self) -> mjtLimited: ...
    @ctrllimited.setter
    def ctrllimited(self, value: Int, /) -> None: ...
    ctrlrange: F64Field
    ctrlspec: IntField
    damping: F64Field
    delay: FloatField
    dynprm: F64Field
    @property
    def dyntype(self) -> mjtDyn: ...
    @dyntype.setter
    def dyntype(self, value: Int, /) -> None: ...
    ffrange: F64Field
    @property
    def forcelimited(self) -> mjtLimited: ...
    @forcelimited.setter
    def forcelimited(self, value: Int, /) -> None: ...
    forcerange: F64Field
    gainprm: F64Field
    @property
    def gaintype(self) -> mjtGain: ...
    @gaintype.setter
    def gaintype(self, value: Int, /) -> None: ...
    gear: F64Field
    group: IntField
    @property
    def id(self) -> int: ...
    inheritrange: FloatField
    interp: IntField
    lengthrange: F64Field
    nsample: IntField
    @property
    def signature(self) -> int: ...
    @property
    def trntype(self) -> mjtTrn: ...
    @trntype.setter
    def trntype(self, value: Int, /) -> None: ...
    @property
    def userdata(self) -> MjDoubleVec: ...
    @userdata.setter
    def userdata(self, value: Any, /) -> None: ...
    velrange: F64Field
    @property
    def type(self) -> mjtActuator: ...
    @type.setter
    def type(self, value: Int, /) -> None: ...

class MjsPlugin:
    active: bool
    config: dict[Any, Any]
    info: str
    name: str
    plugin_name: str
    @property
    def compiler(self) -> MjsCompiler: ...
    id: IntField
    @property
    def signature(self) -> int: ...

class MjsOrientation:
    axisangle: F64Field
    euler: F64Field
    xyaxes: F64Field
    zaxis: F64Field
    @property
    def type(self) -> mjtOrientation: ...
    @type.setter
    def type(self, value: Int, /) -> None: ...

class MjsWrap:
    info: str
    @property
    def coef(self) -> Any: ...
    @property
    def divisor(self) -> Any: ...
    @property
    def sidesite(self) -> MjsSite: ...
    @property
    def target(self) -> Any: ...
    @property
    def type(self) -> mjtWrap: ...
    @type.setter
    def type(self, value: Int, /) -> None: ...

class MjOption:
    ccd_iterations: IntField
    ccd_tolerance: FloatField
    cone: IntField
    density: FloatField
    disableactuator: IntField
    disableflags: IntField
    enableflags: IntField
    gravity: F64Field
    impratio: FloatField
    integrator: IntField
    iterations: IntField
    jacobian: IntField
    ls_iterations: IntField
    ls_tolerance: FloatField
    magnetic: F64Field
    noslip_iterations: IntField
    noslip_tolerance: FloatField
    o_friction: F64Field
    o_margin: FloatField
    o_solimp: F64Field
    o_solref: F64Field
    sdf_initpoints: IntField
    sdf_iterations: IntField
    sleep_tolerance: FloatField
    solver: IntField
    timestep: FloatField
    tolerance: FloatField
    viscosity: FloatField
    wind: F64Field

class MjStatistic:
    center: F64Field
    extent: FloatField
    meaninertia: FloatField
    meanmass: FloatField
    meansize: FloatField

class MjVisual:
    global_: _structs.MjVisual.Global
    headlight: MjVisualHeadlight
    map: _structs.MjVisual.Map
    quality: _structs.MjVisual.Quality
    rgba: MjVisualRgba
    scale: _structs.MjVisual.Scale

class MjVisualHeadlight:
    active: IntField
    ambient: F32Field
    diffuse: F32Field
    specular: F32Field

class MjVisualRgba:
    actuator: F32Field
    actuatornegative: F32Field
    actuatorpositive: F32Field
    bv: F32Field
    bvactive: F32Field
    camera: F32Field
    com: F32Field
    connect: F32Field
    constraint: F32Field
    contactforce: F32Field
    contactfriction: F32Field
    contactgap: F32Field
    contactpoint: F32Field
    contacttorque: F32Field
    crankbroken: F32Field
    fog: F32Field
    force: F32Field
    frustum: F32Field
    haze: F32Field
    inertia: F32Field
    joint: F32Field
    light: F32Field
    rangefinder: F32Field
    selectpoint: F32Field
    slidercrank: F32Field

class MjsCompiler:
    LRopt: MjLROpt
    alignfree: bool
    autolimits: bool
    balanceinertia: bool
    degree: bool
    discardvisual: bool
    fitaabb: bool
    fusestatic: bool
    meshdir: str
    savecanonical: bool
    savecompiled: bool
    saveinertial: bool
    texturedir: str
    usethread: bool
    authored: IntField
    boundinertia: FloatField
    boundmass: FloatField
    @property
    def conflict(self) -> mjtConflict: ...
    @conflict.setter
    def conflict(self, value: Int, /) -> None: ...
    @property
    def eulerseq(self) -> MjCharVec: ...
    @eulerseq.setter
    def eulerseq(self, value: Any, /) -> None: ...
    @property
    def inertiafromgeom(self) -> mjtInertiaFromGeom: ...
    @inertiafromgeom.setter
    def inertiafromgeom(self, value: Int, /) -> None: ...
    inertiagrouprange: I32Field
    @property
    def passthrough(self) -> mjtPassthrough: ...
    @passthrough.setter
    def passthrough(self, value: Int, /) -> None: ...
    settotalmass: FloatField

class MjsAuthored:
    disableactuator: IntField
    disableflags: IntField
    enableflags: IntField
    option: IntField
    visual_global: IntField
    visual_headlight: IntField
    visual_map: IntField
    visual_quality: IntField
    visual_rgba: IntField
    visual_scale: IntField

class MjCharVec:
    def __getitem__(self, arg0: Int, /) -> str: ...
    def __init__(self, arg0: str, arg1: Int, /) -> None: ...
    def __iter__(self) -> Iterator[str]: ...
    def __len__(self) -> int: ...
    def __setitem__(self, arg0: Int, arg1: str, /) -> None: ...

class MjStringVec:
    def __getitem__(self, arg0: Int, /) -> str: ...
    def __init__(self, arg0: str, arg1: Int, /) -> None: ...
    def __iter__(self) -> Iterator[str]: ...
    def __len__(self) -> int: ...
    def __setitem__(self, arg0: Int, arg1: str, /) -> None: ...

class MjByteVec:
    def __getitem__(self, arg0: Int, /) -> Any: ...
    def __init__(self, arg0: Any, arg1: Int, /) -> None: ...
    def __iter__(self) -> Iterator[Any]: ...
    def __len__(self) -> int: ...
    def __setitem__(self, arg0: Int, arg1: Any, /) -> None: ...

class MjDoubleVec:
    def __getitem__(self, arg0: Int, /) -> float: ...
    def __init__(self, arg0: Float, arg1: Int, /) -> None: ...
    def __iter__(self) -> Iterator[float]: ...
    def __len__(self) -> int: ...
    def __setitem__(self, arg0: Int, arg1: Float, /) -> None: ...

class MjFloatVec:
    def __getitem__(self, arg0: Int, /) -> float: ...
    def __init__(self, arg0: Float, arg1: Int, /) -> None: ...
    def __iter__(self) -> Iterator[float]: ...
    def __len__(self) -> int: ...
    def __setitem__(self, arg0: Int, arg1: Float, /) -> None: ...

class MjIntVec:
    def __getitem__(self, arg0: Int, /) -> int: ...
    def __init__(self, arg0: Int, arg1: Int, /) -> None: ...
    def __iter__(self) -> Iterator[int]: ...
    def __len__(self) -> int: ...
    def __setitem__(self, arg0: Int, arg1: Int, /) -> None: ...

class MjVfs:
    def __contains__(self, arg0: str, /) -> bool: ...
    def __delitem__(self, arg0: str, /) -> None: ...
    def __enter__(self) -> MjVfs: ...
    def __exit__(self, arg0: Any, arg1: Any, arg2: Any, /) -> None: ...
    def __init__(self) -> None: ...
    def __setitem__(self, arg0: str, arg1: bytes, /) -> None: ...
    def close(self) -> None: ...

class MjsTendonPath:
    def __getitem__(self, arg0: Int, /) -> MjsWrap: ...
    def __len__(self) -> int: ...
