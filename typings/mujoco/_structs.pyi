"""Types of MuJoCo 4.0, made with pybind11-stubgen and shortened by hand."""

from collections.abc import Mapping
from typing import Any, overload

import numpy as np
import numpy.typing as npt
from mujoco._fields import (
    F64,
    I32,
    I64,
    BoolField,
    F32Field,
    F64Field,
    FloatField,
    I32Field,
    I64Field,
    Int,
    IntField,
    U8Field,
)

class MjOption:
    def __init__(self) -> None: ...
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

class MjVisual:
    class Global:
        azimuth: FloatField
        bvactive: IntField
        cameraid: IntField
        elevation: FloatField
        ellipsoidinertia: IntField
        fovy: FloatField
        glow: FloatField
        ipd: FloatField
        linewidth: FloatField
        offheight: IntField
        offwidth: IntField
        orthographic: IntField
        realtime: FloatField

    class Quality:
        numquads: IntField
        numslices: IntField
        numstacks: IntField
        offsamples: IntField
        shadowsize: IntField

    class Headlight:
        active: IntField
        ambient: F32Field
        diffuse: F32Field
        specular: F32Field

    class Map:
        actuatortendon: FloatField
        alpha: FloatField
        fogend: FloatField
        fogstart: FloatField
        force: FloatField
        haze: FloatField
        shadowclip: FloatField
        shadowscale: FloatField
        stiffness: FloatField
        stiffnessrot: FloatField
        torque: FloatField
        zfar: FloatField
        znear: FloatField

    class Scale:
        actuatorlength: FloatField
        actuatorwidth: FloatField
        camera: FloatField
        com: FloatField
        connect: FloatField
        constraint: FloatField
        contactheight: FloatField
        contactwidth: FloatField
        forcewidth: FloatField
        framelength: FloatField
        framewidth: FloatField
        frustum: FloatField
        jointlength: FloatField
        jointwidth: FloatField
        light: FloatField
        selectpoint: FloatField
        slidercrank: FloatField

    class Rgba:
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

    global_: MjVisual.Global
    headlight: MjVisual.Headlight
    map: MjVisual.Map
    quality: MjVisual.Quality
    rgba: MjVisual.Rgba
    scale: MjVisual.Scale

class MjModel:
    flg_adhesion: bool
    flg_gravcomp: bool
    flg_surfacevel: bool
    opt: MjOption
    stat: MjStatistic
    vis: MjVisual
    def bind(self, specs: Any) -> Any: ...
    @staticmethod
    def from_binary_path(
        filename: str, assets: Mapping[str, bytes] | None = None, vfs: Any = None
    ) -> MjModel: ...
    @staticmethod
    def from_xml_path(
        filename: str, assets: Mapping[str, bytes] | None = None, vfs: Any = None
    ) -> MjModel: ...
    @staticmethod
    def from_xml_string(
        xml: str, assets: Mapping[str, bytes] | None = None, vfs: Any = None
    ) -> MjModel: ...
    @overload
    def actuator(self, arg0: Int, /) -> _MjModelActuatorViews: ...
    @overload
    def actuator(self, name: str = "") -> _MjModelActuatorViews: ...
    def bind_scalar(self, spec: Any) -> Any: ...
    @overload
    def body(self, arg0: Int, /) -> _MjModelBodyViews: ...
    @overload
    def body(self, name: str = "") -> _MjModelBodyViews: ...
    @overload
    def cam(self, arg0: Int, /) -> _MjModelCameraViews: ...
    @overload
    def cam(self, name: str = "") -> _MjModelCameraViews: ...
    @overload
    def camera(self, arg0: Int, /) -> _MjModelCameraViews: ...
    @overload
    def camera(self, name: str = "") -> _MjModelCameraViews: ...
    @overload
    def eq(self, arg0: Int, /) -> _MjModelEqualityViews: ...
    @overload
    def eq(self, name: str = "") -> _MjModelEqualityViews: ...
    @overload
    def equality(self, arg0: Int, /) -> _MjModelEqualityViews: ...
    @overload
    def equality(self, name: str = "") -> _MjModelEqualityViews: ...
    @overload
    def exclude(self, arg0: Int, /) -> _MjModelExcludeViews: ...
    @overload
    def exclude(self, name: str = "") -> _MjModelExcludeViews: ...
    @overload
    def geom(self, arg0: Int, /) -> _MjModelGeomViews: ...
    @overload
    def geom(self, name: str = "") -> _MjModelGeomViews: ...
    @overload
    def hfield(self, arg0: Int, /) -> _MjModelHfieldViews: ...
    @overload
    def hfield(self, name: str = "") -> _MjModelHfieldViews: ...
    @overload
    def jnt(self, arg0: Int, /) -> _MjModelJointViews: ...
    @overload
    def jnt(self, name: str = "") -> _MjModelJointViews: ...
    @overload
    def joint(self, arg0: Int, /) -> _MjModelJointViews: ...
    @overload
    def joint(self, name: str = "") -> _MjModelJointViews: ...
    @overload
    def key(self, arg0: Int, /) -> _MjModelKeyframeViews: ...
    @overload
    def key(self, name: str = "") -> _MjModelKeyframeViews: ...
    @overload
    def keyframe(self, arg0: Int, /) -> _MjModelKeyframeViews: ...
    @overload
    def keyframe(self, name: str = "") -> _MjModelKeyframeViews: ...
    @overload
    def light(self, arg0: Int, /) -> _MjModelLightViews: ...
    @overload
    def light(self, name: str = "") -> _MjModelLightViews: ...
    @overload
    def mat(self, arg0: Int, /) -> _MjModelMaterialViews: ...
    @overload
    def mat(self, name: str = "") -> _MjModelMaterialViews: ...
    @overload
    def material(self, arg0: Int, /) -> _MjModelMaterialViews: ...
    @overload
    def material(self, name: str = "") -> _MjModelMaterialViews: ...
    @overload
    def mesh(self, arg0: Int, /) -> _MjModelMeshViews: ...
    @overload
    def mesh(self, name: str = "") -> _MjModelMeshViews: ...
    @overload
    def numeric(self, arg0: Int, /) -> _MjModelNumericViews: ...
    @overload
    def numeric(self, name: str = "") -> _MjModelNumericViews: ...
    @overload
    def pair(self, arg0: Int, /) -> _MjModelPairViews: ...
    @overload
    def pair(self, name: str = "") -> _MjModelPairViews: ...
    @overload
    def sensor(self, arg0: Int, /) -> _MjModelSensorViews: ...
    @overload
    def sensor(self, name: str = "") -> _MjModelSensorViews: ...
    @overload
    def site(self, arg0: Int, /) -> _MjModelSiteViews: ...
    @overload
    def site(self, name: str = "") -> _MjModelSiteViews: ...
    @overload
    def skin(self, arg0: Int, /) -> _MjModelSkinViews: ...
    @overload
    def skin(self, name: str = "") -> _MjModelSkinViews: ...
    @overload
    def tendon(self, arg0: Int, /) -> _MjModelTendonViews: ...
    @overload
    def tendon(self, name: str = "") -> _MjModelTendonViews: ...
    @overload
    def tex(self, arg0: Int, /) -> _MjModelTextureViews: ...
    @overload
    def tex(self, name: str = "") -> _MjModelTextureViews: ...
    @overload
    def texture(self, arg0: Int, /) -> _MjModelTextureViews: ...
    @overload
    def texture(self, name: str = "") -> _MjModelTextureViews: ...
    B_colind: I32Field
    B_rowadr: I32Field
    B_rownnz: I32Field
    D_colind: I32Field
    D_diag: I32Field
    D_rowadr: I32Field
    D_rownnz: I32Field
    M_colind: I32Field
    M_rowadr: I32Field
    M_rownnz: I32Field
    @property
    def _sizes(self) -> I64: ...
    actuator_acc0: F64Field
    actuator_actadr: I32Field
    actuator_actearly: BoolField
    actuator_actlimited: BoolField
    actuator_actnum: I32Field
    actuator_actrange: F64Field
    actuator_armature: F64Field
    actuator_biasprm: F64Field
    actuator_biastype: I32Field
    actuator_cranklength: F64Field
    actuator_ctrladr: I32Field
    actuator_ctrllimited: BoolField
    actuator_ctrlnum: I32Field
    actuator_ctrlrange: F64Field
    actuator_ctrlspec: I32Field
    actuator_damping: F64Field
    actuator_dampingpoly: F64Field
    actuator_delay: F64Field
    actuator_dynprm: F64Field
    actuator_dyntype: I32Field
    actuator_forcelimited: BoolField
    actuator_forcerange: F64Field
    actuator_gainprm: F64Field
    actuator_gaintype: I32Field
    actuator_gear: F64Field
    actuator_group: I32Field
    actuator_history: I32Field
    actuator_historyadr: I32Field
    actuator_length0: F64Field
    actuator_lengthrange: F64Field
    actuator_outadr: I32Field
    actuator_outnum: I32Field
    actuator_plugin: I32Field
    actuator_trnid: I32Field
    actuator_trntype: I32Field
    actuator_user: F64Field
    body_bvhadr: I32Field
    body_bvhnum: I32Field
    body_conaffinity: I32Field
    body_contype: I32Field
    body_dofadr: I32Field
    body_dofnum: I32Field
    body_geomadr: I32Field
    body_geomnum: I32Field
    body_gravcomp: F64Field
    body_inertia: F64Field
    body_invweight0: F64Field
    body_ipos: F64Field
    body_iquat: F64Field
    body_jntadr: I32Field
    body_jntnum: I32Field
    body_margin: F64Field
    body_mass: F64Field
    body_mocapid: I32Field
    body_parentid: I32Field
    body_plugin: I32Field
    body_pos: F64Field
    body_quat: F64Field
    body_rootid: I32Field
    body_sameframe: U8Field
    body_simple: U8Field
    body_subtreemass: F64Field
    body_treeid: I32Field
    body_user: F64Field
    body_weldid: I32Field
    bvh_aabb: F64Field
    bvh_child: I32Field
    bvh_depth: I32Field
    bvh_nodeid: I32Field
    cam_bodyid: I32Field
    cam_fovy: F64Field
    cam_intrinsic: F32Field
    cam_ipd: F64Field
    cam_mat0: F64Field
    cam_mode: I32Field
    cam_output: I32Field
    cam_pos: F64Field
    cam_pos0: F64Field
    cam_poscom0: F64Field
    cam_projection: I32Field
    cam_quat: F64Field
    cam_resolution: I32Field
    cam_sensorsize: F32Field
    cam_targetbodyid: I32Field
    cam_user: F64Field
    dof_M0: F64Field
    dof_Madr: I32Field
    dof_armature: F64Field
    dof_bodyid: I32Field
    dof_damping: F64Field
    dof_dampingpoly: F64Field
    dof_frictionloss: F64Field
    dof_invweight0: F64Field
    dof_jntid: I32Field
    dof_length: F64Field
    dof_parentid: I32Field
    dof_simplenum: I32Field
    dof_solimp: F64Field
    dof_solref: F64Field
    dof_treeid: I32Field
    efm0_L: F64Field
    efm0_L_colind: I32Field
    efm0_L_rowadr: I32Field
    efm0_L_rownnz: I32Field
    efm0_dofid: I32Field
    efmC_perm: I32Field
    eq_active0: BoolField
    eq_data: F64Field
    eq_obj1id: I32Field
    eq_obj2id: I32Field
    eq_objtype: I32Field
    eq_solimp: F64Field
    eq_solref: F64Field
    eq_type: I32Field
    exclude_signature: I32Field
    flex_activelayers: I32Field
    flex_bending: F64Field
    flex_bendingadr: I32Field
    flex_bvhadr: I32Field
    flex_bvhnum: I32Field
    flex_cellnum: I32Field
    flex_centered: BoolField
    flex_conaffinity: I32Field
    flex_condim: I32Field
    flex_contype: I32Field
    flex_damping: F64Field
    flex_dim: I32Field
    flex_edge: I32Field
    flex_edgeadr: I32Field
    flex_edgedamping: F64Field
    flex_edgeequality: I32Field
    flex_edgeflap: I32Field
    flex_edgenum: I32Field
    flex_edgestiffness: F64Field
    flex_elem: I32Field
    flex_elemadr: I32Field
    flex_elemdataadr: I32Field
    flex_elemedge: I32Field
    flex_elemedgeadr: I32Field
    flex_elemlayer: I32Field
    flex_elemnum: I32Field
    flex_elemtexcoord: I32Field
    flex_flatskin: BoolField
    flex_friction: F64Field
    flex_gap: F64Field
    flex_group: I32Field
    flex_interp: I32Field
    flex_margin: F64Field
    flex_matid: I32Field
    flex_node: F64Field
    flex_node0: F64Field
    flex_nodeadr: I32Field
    flex_nodebodyid: I32Field
    flex_nodenum: I32Field
    flex_passive: I32Field
    flex_plasticadr: I32Field
    flex_plasticmode: I32Field
    flex_priority: I32Field
    flex_radius: F64Field
    flex_rgba: F32Field
    flex_rigid: BoolField
    flex_selfcollide: I32Field
    flex_shell: I32Field
    flex_shelldataadr: I32Field
    flex_shellnum: I32Field
    flex_size: F64Field
    flex_solimp: F64Field
    flex_solmix: F64Field
    flex_solref: F64Field
    flex_stiffness: F64Field
    flex_stiffnessadr: I32Field
    flex_texcoord: F32Field
    flex_texcoordadr: I32Field
    flex_vert: F64Field
    flex_vert0: F64Field
    flex_vertadr: I32Field
    flex_vertbodyid: I32Field
    flex_vertcell: I32Field
    flex_vertnum: I32Field
    flex_yield: F64Field
    flexedge_J_colind: I32Field
    flexedge_J_rowadr: I32Field
    flexedge_J_rownnz: I32Field
    flexedge_invweight0: F64Field
    flexedge_length0: F64Field
    flexedge_rigid: BoolField
    geom_aabb: F64Field
    geom_adhesion: F64Field
    geom_bodyid: I32Field
    geom_castshadow: BoolField
    geom_conaffinity: I32Field
    geom_condim: I32Field
    geom_contype: I32Field
    geom_dataid: I32Field
    geom_fluid: F64Field
    geom_friction: F64Field
    geom_gap: F64Field
    geom_group: I32Field
    geom_margin: F64Field
    geom_matid: I32Field
    geom_plugin: I32Field
    geom_pos: F64Field
    geom_priority: I32Field
    geom_quat: F64Field
    geom_rbound: F64Field
    geom_rgba: F32Field
    geom_sameframe: U8Field
    geom_size: F64Field
    geom_solimp: F64Field
    geom_solmix: F64Field
    geom_solref: F64Field
    geom_surfacevel: F64Field
    geom_type: I32Field
    geom_user: F64Field
    hfield_adr: I32Field
    hfield_data: F32Field
    hfield_ncol: I32Field
    hfield_nrow: I32Field
    hfield_pathadr: I32Field
    hfield_size: F64Field
    jnt_actfrclimited: BoolField
    jnt_actfrcrange: F64Field
    jnt_actgravcomp: BoolField
    jnt_actuatorid: I32Field
    jnt_axis: F64Field
    jnt_bodyid: I32Field
    jnt_dofadr: I32Field
    jnt_group: I32Field
    jnt_limited: BoolField
    jnt_margin: F64Field
    jnt_plasticadr: I32Field
    jnt_pos: F64Field
    jnt_qposadr: I32Field
    jnt_range: F64Field
    jnt_solimp: F64Field
    jnt_solref: F64Field
    jnt_springyield: F64Field
    jnt_stiffness: F64Field
    jnt_stiffnesspoly: F64Field
    jnt_type: I32Field
    jnt_user: F64Field
    key_act: F64Field
    key_ctrl: F64Field
    key_mpos: F64Field
    key_mquat: F64Field
    key_plastic: F64Field
    key_qpos: F64Field
    key_qvel: F64Field
    key_time: F64Field
    light_active: BoolField
    light_ambient: F32Field
    light_attenuation: F32Field
    light_bodyid: I32Field
    light_bulbradius: F32Field
    light_castshadow: BoolField
    light_cutoff: F32Field
    light_diffuse: F32Field
    light_dir: F64Field
    light_dir0: F64Field
    light_exponent: F32Field
    light_intensity: F32Field
    light_mode: I32Field
    light_pos: F64Field
    light_pos0: F64Field
    light_poscom0: F64Field
    light_range: F32Field
    light_softness: F32Field
    light_specular: F32Field
    light_targetbodyid: I32Field
    light_texid: I32Field
    light_type: I32Field
    mapD2M: I32Field
    mapM2D: I32Field
    mapM2M: I32Field
    mat_emission: F32Field
    mat_metallic: F32Field
    mat_reflectance: F32Field
    mat_rgba: F32Field
    mat_roughness: F32Field
    mat_shininess: F32Field
    mat_specular: F32Field
    mat_texid: I32Field
    mat_texrepeat: F32Field
    mat_texuniform: BoolField
    mesh_bvhadr: I32Field
    mesh_bvhnum: I32Field
    mesh_extrema: I32Field
    mesh_face: I32Field
    mesh_faceadr: I32Field
    mesh_facenormal: I32Field
    mesh_facenum: I32Field
    mesh_facetexcoord: I32Field
    mesh_graph: I32Field
    mesh_graphadr: I32Field
    mesh_normal: F32Field
    mesh_normaladr: I32Field
    mesh_normalnum: I32Field
    mesh_octadr: I32Field
    mesh_octnum: I32Field
    mesh_pathadr: I32Field
    mesh_polyadr: I32Field
    mesh_polymap: I32Field
    mesh_polymapadr: I32Field
    mesh_polymapnum: I32Field
    mesh_polynormal: F64Field
    mesh_polynum: I32Field
    mesh_polyvert: I32Field
    mesh_polyvertadr: I32Field
    mesh_polyvertnum: I32Field
    mesh_pos: F64Field
    mesh_quat: F64Field
    mesh_scale: F64Field
    mesh_texcoord: F32Field
    mesh_texcoordadr: I32Field
    mesh_texcoordnum: I32Field
    mesh_vert: F32Field
    mesh_vertadr: I32Field
    mesh_vertnum: I32Field
    @property
    def nB(self) -> int: ...
    @property
    def nC(self) -> int: ...
    @property
    def nD(self) -> int: ...
    @property
    def nJfe(self) -> int: ...
    @property
    def nJmom(self) -> int: ...
    @property
    def nJten(self) -> int: ...
    @property
    def nM(self) -> int: ...
    @property
    def na(self) -> int: ...
    @property
    def nactuator(self) -> int: ...
    name_actuatoradr: I32Field
    name_bodyadr: I32Field
    name_camadr: I32Field
    name_eqadr: I32Field
    name_excludeadr: I32Field
    name_flexadr: I32Field
    name_geomadr: I32Field
    name_hfieldadr: I32Field
    name_jntadr: I32Field
    name_keyadr: I32Field
    name_lightadr: I32Field
    name_matadr: I32Field
    name_meshadr: I32Field
    name_numericadr: I32Field
    name_pairadr: I32Field
    name_pluginadr: I32Field
    name_sensoradr: I32Field
    name_siteadr: I32Field
    name_skinadr: I32Field
    name_tendonadr: I32Field
    name_texadr: I32Field
    name_textadr: I32Field
    name_tupleadr: I32Field
    @property
    def names(self) -> bytes: ...
    names_map: I32Field
    @property
    def narena(self) -> int: ...
    @property
    def nbody(self) -> int: ...
    @property
    def nbuffer(self) -> int: ...
    @property
    def nbvh(self) -> int: ...
    @property
    def nbvhdynamic(self) -> int: ...
    @property
    def nbvhstatic(self) -> int: ...
    @property
    def ncam(self) -> int: ...
    @property
    def nconmax(self) -> int: ...
    @property
    def nefm0L(self) -> int: ...
    @property
    def nefm0dof(self) -> int: ...
    @property
    def nefmCvert(self) -> int: ...
    @property
    def nemax(self) -> int: ...
    @property
    def neq(self) -> int: ...
    @property
    def nexclude(self) -> int: ...
    @property
    def nflex(self) -> int: ...
    @property
    def nflexbending(self) -> int: ...
    @property
    def nflexedge(self) -> int: ...
    @property
    def nflexelem(self) -> int: ...
    @property
    def nflexelemdata(self) -> int: ...
    @property
    def nflexelemedge(self) -> int: ...
    @property
    def nflexnode(self) -> int: ...
    @property
    def nflexshelldata(self) -> int: ...
    @property
    def nflexstiffness(self) -> int: ...
    @property
    def nflextexcoord(self) -> int: ...
    @property
    def nflexvert(self) -> int: ...
    @property
    def ngeom(self) -> int: ...
    @property
    def ngravcomp(self) -> int: ...
    @property
    def nhfield(self) -> int: ...
    @property
    def nhfielddata(self) -> int: ...
    @property
    def nhistory(self) -> int: ...
    @property
    def njmax(self) -> int: ...
    @property
    def njnt(self) -> int: ...
    @property
    def nkey(self) -> int: ...
    @property
    def nlight(self) -> int: ...
    @property
    def nmat(self) -> int: ...
    @property
    def nmesh(self) -> int: ...
    @property
    def nmeshdegmax(self) -> int: ...
    @property
    def nmeshface(self) -> int: ...
    @property
    def nmeshgraph(self) -> int: ...
    @property
    def nmeshnormal(self) -> int: ...
    @property
    def nmeshpoly(self) -> int: ...
    @property
    def nmeshpolymap(self) -> int: ...
    @property
    def nmeshpolyvert(self) -> int: ...
    @property
    def nmeshtexcoord(self) -> int: ...
    @property
    def nmeshvert(self) -> int: ...
    @property
    def nmocap(self) -> int: ...
    @property
    def nnames(self) -> int: ...
    @property
    def nnames_map(self) -> int: ...
    @property
    def nnumeric(self) -> int: ...
    @property
    def nnumericdata(self) -> int: ...
    @property
    def noct(self) -> int: ...
    @property
    def nout(self) -> int: ...
    @property
    def npair(self) -> int: ...
    @property
    def npaths(self) -> int: ...
    @property
    def nplastic(self) -> int: ...
    @property
    def nplugin(self) -> int: ...
    @property
    def npluginattr(self) -> int: ...
    @property
    def npluginstate(self) -> int: ...
    @property
    def npolygonmax(self) -> int: ...
    @property
    def nq(self) -> int: ...
    @property
    def nsensor(self) -> int: ...
    @property
    def nsensordata(self) -> int: ...
    @property
    def nsite(self) -> int: ...
    @property
    def nskin(self) -> int: ...
    @property
    def nskinbone(self) -> int: ...
    @property
    def nskinbonevert(self) -> int: ...
    @property
    def nskinface(self) -> int: ...
    @property
    def nskintexvert(self) -> int: ...
    @property
    def nskinvert(self) -> int: ...
    @property
    def ntendon(self) -> int: ...
    @property
    def ntex(self) -> int: ...
    @property
    def ntexdata(self) -> int: ...
    @property
    def ntext(self) -> int: ...
    @property
    def ntextdata(self) -> int: ...
    @property
    def ntree(self) -> int: ...
    @property
    def ntuple(self) -> int: ...
    @property
    def ntupledata(self) -> int: ...
    @property
    def nu(self) -> int: ...
    numeric_adr: I32Field
    numeric_data: F64Field
    numeric_size: I32Field
    @property
    def nuser_actuator(self) -> int: ...
    @property
    def nuser_body(self) -> int: ...
    @property
    def nuser_cam(self) -> int: ...
    @property
    def nuser_geom(self) -> int: ...
    @property
    def nuser_jnt(self) -> int: ...
    @property
    def nuser_sensor(self) -> int: ...
    @property
    def nuser_site(self) -> int: ...
    @property
    def nuser_tendon(self) -> int: ...
    @property
    def nuserdata(self) -> int: ...
    @property
    def nv(self) -> int: ...
    @property
    def nwrap(self) -> int: ...
    oct_aabb: F64Field
    oct_child: I32Field
    oct_coeff: F64Field
    oct_depth: I32Field
    pair_adhesion: F64Field
    pair_dim: I32Field
    pair_friction: F64Field
    pair_gap: F64Field
    pair_geom1: I32Field
    pair_geom2: I32Field
    pair_margin: F64Field
    pair_signature: I32Field
    pair_solimp: F64Field
    pair_solref: F64Field
    pair_solreffriction: F64Field
    @property
    def paths(self) -> bytes: ...
    plugin: I32Field
    @property
    def plugin_attr(self) -> npt.NDArray[np.int8]: ...
    @plugin_attr.setter
    def plugin_attr(self, value: Any, /) -> None: ...
    plugin_attradr: I32Field
    plugin_stateadr: I32Field
    plugin_statenum: I32Field
    qpos0: F64Field
    qpos_spring: F64Field
    sensor_adr: I32Field
    sensor_cutoff: F64Field
    sensor_datatype: I32Field
    sensor_delay: F64Field
    sensor_dim: I32Field
    sensor_history: I32Field
    sensor_historyadr: I32Field
    sensor_interval: F64Field
    sensor_intprm: I32Field
    sensor_needstage: I32Field
    sensor_noise: F64Field
    sensor_objid: I32Field
    sensor_objtype: I32Field
    sensor_plugin: I32Field
    sensor_refid: I32Field
    sensor_reftype: I32Field
    sensor_type: I32Field
    sensor_user: F64Field
    @property
    def signature(self) -> int: ...
    site_bodyid: I32Field
    site_dataid: I32Field
    site_group: I32Field
    site_matid: I32Field
    site_pos: F64Field
    site_quat: F64Field
    site_rgba: F32Field
    site_sameframe: U8Field
    site_size: F64Field
    site_type: I32Field
    site_user: F64Field
    skin_boneadr: I32Field
    skin_bonebindpos: F32Field
    skin_bonebindquat: F32Field
    skin_bonebodyid: I32Field
    skin_bonenum: I32Field
    skin_bonevertadr: I32Field
    skin_bonevertid: I32Field
    skin_bonevertnum: I32Field
    skin_bonevertweight: F32Field
    skin_face: I32Field
    skin_faceadr: I32Field
    skin_facenum: I32Field
    skin_group: I32Field
    skin_inflate: F32Field
    skin_matid: I32Field
    skin_pathadr: I32Field
    skin_rgba: F32Field
    skin_texcoord: F32Field
    skin_texcoordadr: I32Field
    skin_vert: F32Field
    skin_vertadr: I32Field
    skin_vertnum: I32Field
    ten_J_colind: I32Field
    ten_J_rowadr: I32Field
    ten_J_rownnz: I32Field
    tendon_actfrclimited: BoolField
    tendon_actfrcrange: F64Field
    tendon_actuatorid: I32Field
    tendon_adr: I32Field
    tendon_armature: F64Field
    tendon_damping: F64Field
    tendon_dampingpoly: F64Field
    tendon_frictionloss: F64Field
    tendon_group: I32Field
    tendon_invweight0: F64Field
    tendon_length0: F64Field
    tendon_lengthspring: F64Field
    tendon_limited: BoolField
    tendon_margin: F64Field
    tendon_matid: I32Field
    tendon_num: I32Field
    tendon_plasticadr: I32Field
    tendon_range: F64Field
    tendon_rgba: F32Field
    tendon_solimp_fri: F64Field
    tendon_solimp_lim: F64Field
    tendon_solref_fri: F64Field
    tendon_solref_lim: F64Field
    tendon_springyield: F64Field
    tendon_stiffness: F64Field
    tendon_stiffnesspoly: F64Field
    tendon_treeid: I32Field
    tendon_treenum: I32Field
    tendon_type: I32Field
    tendon_user: F64Field
    tendon_width: F64Field
    tex_adr: I64Field
    tex_colorspace: I32Field
    tex_contenttypeadr: I32Field
    tex_data: U8Field
    tex_height: I32Field
    tex_nchannel: I32Field
    tex_pathadr: I32Field
    tex_type: I32Field
    tex_width: I32Field
    text_adr: I32Field
    @property
    def text_data(self) -> bytes: ...
    text_size: I32Field
    tree_bodyadr: I32Field
    tree_bodynum: I32Field
    tree_dofadr: I32Field
    tree_dofnum: I32Field
    tree_sleep_policy: I32Field
    tuple_adr: I32Field
    tuple_objid: I32Field
    tuple_objprm: F64Field
    tuple_objtype: I32Field
    tuple_size: I32Field
    wrap_objid: I32Field
    wrap_prm: F64Field
    wrap_type: I32Field
    @overload
    def tuple(self, arg0: Int, /) -> _MjModelTupleViews: ...
    @overload
    def tuple(self, name: str = "") -> _MjModelTupleViews: ...

class _MjModelActuatorViews:
    acc0: F64Field
    actadr: I32Field
    actlimited: BoolField
    actnum: I32Field
    actrange: F64Field
    biasprm: F64Field
    biastype: I32Field
    cranklength: F64Field
    ctrllimited: BoolField
    ctrlrange: F64Field
    dynprm: F64Field
    dyntype: I32Field
    forcelimited: BoolField
    forcerange: F64Field
    gainprm: F64Field
    gaintype: I32Field
    gear: F64Field
    group: I32Field
    @property
    def id(self) -> int: ...
    length0: F64Field
    lengthrange: F64Field
    @property
    def name(self) -> str: ...
    trnid: I32Field
    trntype: I32Field
    user: F64Field

class _MjModelBodyViews:
    dofadr: I32Field
    dofnum: I32Field
    geomadr: I32Field
    geomnum: I32Field
    @property
    def id(self) -> int: ...
    inertia: F64Field
    invweight0: F64Field
    ipos: F64Field
    iquat: F64Field
    jntadr: I32Field
    jntnum: I32Field
    mass: F64Field
    mocapid: I32Field
    @property
    def name(self) -> str: ...
    parentid: I32Field
    pos: F64Field
    quat: F64Field
    rootid: I32Field
    sameframe: U8Field
    simple: U8Field
    subtreemass: F64Field
    user: F64Field
    weldid: I32Field

class _MjModelCameraViews:
    bodyid: I32Field
    fovy: F64Field
    @property
    def id(self) -> int: ...
    ipd: F64Field
    mat0: F64Field
    mode: I32Field
    @property
    def name(self) -> str: ...
    pos: F64Field
    pos0: F64Field
    poscom0: F64Field
    quat: F64Field
    targetbodyid: I32Field
    user: F64Field

class _MjModelEqualityViews:
    active0: BoolField
    data: F64Field
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    obj1id: I32Field
    obj2id: I32Field
    solimp: F64Field
    solref: F64Field
    type: I32Field

class _MjModelExcludeViews:
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    signature: I32Field

class _MjModelGeomViews:
    bodyid: I32Field
    castshadow: BoolField
    conaffinity: I32Field
    condim: I32Field
    contype: I32Field
    dataid: I32Field
    friction: F64Field
    gap: F64Field
    group: I32Field
    @property
    def id(self) -> int: ...
    margin: F64Field
    matid: I32Field
    @property
    def name(self) -> str: ...
    pos: F64Field
    priority: I32Field
    quat: F64Field
    rbound: F64Field
    rgba: F32Field
    sameframe: U8Field
    size: F64Field
    solimp: F64Field
    solmix: F64Field
    solref: F64Field
    user: F64Field
    type: I32Field

class _MjModelHfieldViews:
    adr: I32Field
    data: F32Field
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    ncol: I32Field
    nrow: I32Field
    pathadr: I32Field
    size: F64Field

class _MjModelJointViews:
    M0: F64Field
    Madr: I32Field
    armature: F64Field
    axis: F64Field
    bodyid: I32Field
    damping: F64Field
    dampingpoly: F64Field
    dofadr: I32Field
    frictionloss: F64Field
    group: I32Field
    @property
    def id(self) -> int: ...
    invweight0: F64Field
    jntid: I32Field
    limited: BoolField
    margin: F64Field
    @property
    def name(self) -> str: ...
    parentid: I32Field
    plasticadr: I32Field
    pos: F64Field
    qpos0: F64Field
    qpos_spring: F64Field
    qposadr: I32Field
    simplenum: I32Field
    solimp: F64Field
    solref: F64Field
    springyield: F64Field
    stiffness: F64Field
    stiffnesspoly: F64Field
    user: F64Field
    range: F64Field
    type: I32Field

class _MjModelLightViews:
    active: BoolField
    ambient: F32Field
    attenuation: F32Field
    bodyid: I32Field
    castshadow: BoolField
    cutoff: F32Field
    diffuse: F32Field
    dir: F64Field
    dir0: F64Field
    exponent: F32Field
    @property
    def id(self) -> int: ...
    mode: I32Field
    @property
    def name(self) -> str: ...
    pos: F64Field
    pos0: F64Field
    poscom0: F64Field
    specular: F32Field
    targetbodyid: I32Field
    type: I32Field

class _MjModelMaterialViews:
    emission: F32Field
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    reflectance: F32Field
    rgba: F32Field
    shininess: F32Field
    specular: F32Field
    texid: I32Field
    texrepeat: F32Field
    texuniform: BoolField

class _MjModelMeshViews:
    faceadr: I32Field
    facenum: I32Field
    graphadr: I32Field
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    pathadr: I32Field
    texcoordadr: I32Field
    vertadr: I32Field
    vertnum: I32Field

class _MjModelNumericViews:
    adr: I32Field
    data: F64Field
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    size: I32Field

class _MjModelPairViews:
    dim: I32Field
    friction: F64Field
    gap: F64Field
    geom1: I32Field
    geom2: I32Field
    @property
    def id(self) -> int: ...
    margin: F64Field
    @property
    def name(self) -> str: ...
    signature: I32Field
    solimp: F64Field
    solref: F64Field

class _MjModelSensorViews:
    adr: I32Field
    cutoff: F64Field
    datatype: I32Field
    dim: I32Field
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    needstage: I32Field
    noise: F64Field
    objid: I32Field
    objtype: I32Field
    refid: I32Field
    reftype: I32Field
    user: F64Field
    type: I32Field

class _MjModelSiteViews:
    bodyid: I32Field
    group: I32Field
    @property
    def id(self) -> int: ...
    matid: I32Field
    @property
    def name(self) -> str: ...
    pos: F64Field
    quat: F64Field
    rgba: F32Field
    sameframe: U8Field
    size: F64Field
    user: F64Field
    type: I32Field

class _MjModelSkinViews:
    boneadr: I32Field
    bonenum: I32Field
    faceadr: I32Field
    facenum: I32Field
    @property
    def id(self) -> int: ...
    inflate: F32Field
    matid: I32Field
    @property
    def name(self) -> str: ...
    pathadr: I32Field
    rgba: F32Field
    texcoordadr: I32Field
    vertadr: I32Field
    vertnum: I32Field

class _MjModelTendonViews:
    J_colind: I32Field
    J_rowadr: I32Field
    J_rownnz: I32Field
    _adr: I32Field
    _damping: F64Field
    _dampingpoly: F64Field
    _frictionloss: F64Field
    _group: I32Field
    _invweight0: F64Field
    _length0: F64Field
    _lengthspring: F64Field
    _limited: BoolField
    _margin: F64Field
    _matid: I32Field
    _num: I32Field
    _range: F64Field
    _rgba: F32Field
    _solimp_fri: F64Field
    _solimp_lim: F64Field
    _solref_fri: F64Field
    _solref_lim: F64Field
    _stiffness: F64Field
    _stiffnesspoly: F64Field
    _type: I32Field
    _user: F64Field
    _width: F64Field
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    plasticadr: I32Field
    springyield: F64Field

class _MjModelTextureViews:
    adr: I64Field
    colorspace: I32Field
    contenttypeadr: I32Field
    data: U8Field
    height: I32Field
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    nchannel: I32Field
    pathadr: I32Field
    width: I32Field
    type: I32Field

class _MjModelTupleViews:
    adr: I32Field
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    objid: I32Field
    objprm: F64Field
    objtype: I32Field
    size: I32Field

class _MjModelKeyframeViews:
    act: F64Field
    ctrl: F64Field
    @property
    def id(self) -> int: ...
    mpos: F64Field
    mquat: F64Field
    @property
    def name(self) -> str: ...
    plastic: F64Field
    qpos: F64Field
    qvel: F64Field
    time: F64Field

class MjWarningStat:
    def __init__(self) -> None: ...
    lastinfo: IntField
    number: IntField

class _MjWarningStatList:
    @overload
    def __getitem__(self, arg0: Int, /) -> MjWarningStat: ...
    @overload
    def __getitem__(self, arg0: slice, /) -> _MjWarningStatList: ...
    def __len__(self) -> int: ...
    @property
    def lastinfo(self) -> I32: ...
    @property
    def number(self) -> I32: ...

class MjLogConfig:
    logfile: str
    logto_console: bool
    logto_file: bool
    @staticmethod
    def get() -> MjLogConfig: ...
    def __init__(self) -> None: ...
    def set(self) -> None: ...
    topics: IntField

class MjLogMessage:
    subject: str
    timestamp: bool
    def __init__(self) -> None: ...
    @property
    def body(self) -> Any: ...
    @property
    def file(self) -> Any: ...
    @property
    def func(self) -> Any: ...
    level: IntField
    line: IntField
    topic: IntField

class MjTimerStat:
    def __init__(self) -> None: ...
    duration: FloatField
    number: IntField

class _MjTimerStatList:
    @overload
    def __getitem__(self, arg0: Int, /) -> MjTimerStat: ...
    @overload
    def __getitem__(self, arg0: slice, /) -> _MjTimerStatList: ...
    def __len__(self) -> int: ...
    @property
    def duration(self) -> F64: ...
    @property
    def number(self) -> I32: ...

class MjSolverStat:
    def __init__(self) -> None: ...
    gradient: FloatField
    improvement: FloatField
    lineslope: FloatField
    nactive: IntField
    nchange: IntField
    neval: IntField
    nupdate: IntField

class _MjSolverStatList:
    @overload
    def __getitem__(self, arg0: Int, /) -> MjSolverStat: ...
    @overload
    def __getitem__(self, arg0: slice, /) -> _MjSolverStatList: ...
    def __len__(self) -> int: ...
    @property
    def gradient(self) -> F64: ...
    @property
    def improvement(self) -> F64: ...
    @property
    def lineslope(self) -> F64: ...
    @property
    def nactive(self) -> I32: ...
    @property
    def nchange(self) -> I32: ...
    @property
    def neval(self) -> I32: ...
    @property
    def nupdate(self) -> I32: ...

class MjPreContact:
    def __init__(self) -> None: ...
    dist: FloatField
    normal: F64Field
    pos: F64Field
    tangent: F64Field

class MjContact:
    def __init__(self) -> None: ...
    H: F64Field
    adhesion: FloatField
    dim: IntField
    dist: FloatField
    efc_address: IntField
    elem: I32Field
    exclude: IntField
    flex: I32Field
    frame: F64Field
    friction: F64Field
    geom: I32Field
    geom1: IntField
    geom2: IntField
    includemargin: FloatField
    mu: FloatField
    pos: F64Field
    solimp: F64Field
    solref: F64Field
    solreffriction: F64Field
    surfacevel: F64Field
    vert: I32Field

class _MjContactList:
    @overload
    def __getitem__(self, arg0: Int, /) -> MjContact: ...
    @overload
    def __getitem__(self, arg0: slice, /) -> _MjContactList: ...
    def __len__(self) -> int: ...
    @property
    def H(self) -> F64: ...
    @property
    def adhesion(self) -> F64: ...
    @property
    def dim(self) -> I32: ...
    @property
    def dist(self) -> F64: ...
    @property
    def efc_address(self) -> I32: ...
    @property
    def elem(self) -> I32: ...
    @property
    def exclude(self) -> I32: ...
    @property
    def flex(self) -> I32: ...
    @property
    def frame(self) -> F64: ...
    @property
    def friction(self) -> F64: ...
    @property
    def geom(self) -> I32: ...
    @property
    def geom1(self) -> I32: ...
    @property
    def geom2(self) -> I32: ...
    @property
    def includemargin(self) -> F64: ...
    @property
    def mu(self) -> F64: ...
    @property
    def pos(self) -> F64: ...
    @property
    def solimp(self) -> F64: ...
    @property
    def solref(self) -> F64: ...
    @property
    def solreffriction(self) -> F64: ...
    @property
    def surfacevel(self) -> F64: ...
    @property
    def vert(self) -> I32: ...

class MjData:
    flg_energypos: bool
    flg_energyvel: bool
    flg_rnepost: bool
    flg_subtreevel: bool
    def bind(self, specs: Any) -> Any: ...
    def __init__(self, arg0: MjModel, /) -> None: ...
    @overload
    def actuator(self, arg0: Int, /) -> _MjDataActuatorViews: ...
    @overload
    def actuator(self, name: str = "") -> _MjDataActuatorViews: ...
    def bind_scalar(self, spec: Any) -> Any: ...
    @overload
    def body(self, arg0: Int, /) -> _MjDataBodyViews: ...
    @overload
    def body(self, name: str = "") -> _MjDataBodyViews: ...
    @overload
    def cam(self, arg0: Int, /) -> _MjDataCameraViews: ...
    @overload
    def cam(self, name: str = "") -> _MjDataCameraViews: ...
    @overload
    def camera(self, arg0: Int, /) -> _MjDataCameraViews: ...
    @overload
    def camera(self, name: str = "") -> _MjDataCameraViews: ...
    @overload
    def geom(self, arg0: Int, /) -> _MjDataGeomViews: ...
    @overload
    def geom(self, name: str = "") -> _MjDataGeomViews: ...
    @overload
    def jnt(self, arg0: Int, /) -> _MjDataJointViews: ...
    @overload
    def jnt(self, name: str = "") -> _MjDataJointViews: ...
    @overload
    def joint(self, arg0: Int, /) -> _MjDataJointViews: ...
    @overload
    def joint(self, name: str = "") -> _MjDataJointViews: ...
    @overload
    def light(self, arg0: Int, /) -> _MjDataLightViews: ...
    @overload
    def light(self, name: str = "") -> _MjDataLightViews: ...
    @overload
    def sensor(self, arg0: Int, /) -> _MjDataSensorViews: ...
    @overload
    def sensor(self, name: str = "") -> _MjDataSensorViews: ...
    @overload
    def site(self, arg0: Int, /) -> _MjDataSiteViews: ...
    @overload
    def site(self, name: str = "") -> _MjDataSiteViews: ...
    @overload
    def ten(self, arg0: Int, /) -> _MjDataTendonViews: ...
    @overload
    def ten(self, name: str = "") -> _MjDataTendonViews: ...
    @overload
    def tendon(self, arg0: Int, /) -> _MjDataTendonViews: ...
    @overload
    def tendon(self, name: str = "") -> _MjDataTendonViews: ...
    M: F64Field
    act: F64Field
    act_dot: F64Field
    actuator_force: F64Field
    actuator_length: F64Field
    actuator_moment: F64Field
    actuator_velocity: F64Field
    body_awake: I32Field
    body_awake_ind: I32Field
    bvh_aabb_dyn: F64Field
    bvh_active: BoolField
    cacc: F64Field
    cam_xmat: F64Field
    cam_xpos: F64Field
    cdof: F64Field
    cdof_dot: F64Field
    cfrc_ext: F64Field
    cfrc_int: F64Field
    cinert: F64Field
    @property
    def contact(self) -> _MjContactList: ...
    crb: F64Field
    ctrl: F64Field
    cvel: F64Field
    dof_awake_ind: I32Field
    @property
    def dof_island(self) -> I32: ...
    @property
    def efc_AR(self) -> F64: ...
    @property
    def efc_AR_colind(self) -> I32: ...
    @property
    def efc_AR_rowadr(self) -> I32: ...
    @property
    def efc_AR_rownnz(self) -> I32: ...
    @property
    def efc_D(self) -> F64: ...
    @property
    def efc_J(self) -> F64: ...
    @property
    def efc_J_colind(self) -> I32: ...
    @property
    def efc_J_rowadr(self) -> I32: ...
    @property
    def efc_J_rownnz(self) -> I32: ...
    @property
    def efc_J_rowsuper(self) -> I32: ...
    @property
    def efc_KBIP(self) -> F64: ...
    @property
    def efc_R(self) -> F64: ...
    @property
    def efc_Y(self) -> F64: ...
    @property
    def efc_Y_colind(self) -> I32: ...
    @property
    def efc_Y_rowadr(self) -> I32: ...
    @property
    def efc_Y_rownnz(self) -> I32: ...
    @property
    def efc_aref(self) -> F64: ...
    @property
    def efc_b(self) -> F64: ...
    @property
    def efc_diagA(self) -> F64: ...
    @property
    def efc_force(self) -> F64: ...
    @property
    def efc_frictionloss(self) -> F64: ...
    @property
    def efc_id(self) -> I32: ...
    @property
    def efc_island(self) -> I32: ...
    @property
    def efc_margin(self) -> F64: ...
    @property
    def efc_pos(self) -> F64: ...
    @property
    def efc_state(self) -> I32: ...
    @property
    def efc_type(self) -> I32: ...
    @property
    def efc_vel(self) -> F64: ...
    @property
    def efm_K_colind(self) -> I32: ...
    @property
    def efm_K_rowadr(self) -> I32: ...
    @property
    def efm_K_rownnz(self) -> I32: ...
    @property
    def efm_K_val(self) -> F64: ...
    @property
    def efm_L(self) -> F64: ...
    efm_active: IntField
    @property
    def efm_aid(self) -> I32: ...
    @property
    def efm_ak(self) -> F64: ...
    @property
    def efm_as(self) -> F64: ...
    @property
    def efm_c(self) -> F64: ...
    @property
    def efm_ca(self) -> F64: ...
    @property
    def efm_ck(self) -> F64: ...
    @property
    def efm_con_ind(self) -> I32: ...
    @property
    def efm_con_val(self) -> F64: ...
    @property
    def efm_diag(self) -> F64: ...
    @property
    def efm_dofid(self) -> I32: ...
    @property
    def efm_fluid(self) -> F64: ...
    @property
    def efm_sdiag(self) -> F64: ...
    @property
    def efm_tid(self) -> I32: ...
    @property
    def efm_tk(self) -> F64: ...
    @property
    def efm_ts(self) -> F64: ...
    energy: F64Field
    eq_active: BoolField
    flex_hessian_valid: BoolField
    flexedge_J: F64Field
    flexedge_hessian: F64Field
    flexedge_length: F64Field
    flexedge_velocity: F64Field
    flexelem_aabb: F64Field
    flexelem_krot: F64Field
    flexvert_conage: I32Field
    flexvert_hessian: F64Field
    flexvert_lambda: F64Field
    flexvert_xpos: F64Field
    geom_xmat: F64Field
    geom_xpos: F64Field
    geom_xquat: F64Field
    history: F64Field
    @property
    def iacc(self) -> F64: ...
    @property
    def iacc_smooth(self) -> F64: ...
    @property
    def iefc_D(self) -> F64: ...
    @property
    def iefc_R(self) -> F64: ...
    @property
    def iefc_aref(self) -> F64: ...
    @property
    def iefc_force(self) -> F64: ...
    @property
    def iefc_frictionloss(self) -> F64: ...
    @property
    def iefc_id(self) -> I32: ...
    @property
    def iefc_state(self) -> I32: ...
    @property
    def iefc_type(self) -> I32: ...
    @property
    def ifrc_constraint(self) -> F64: ...
    @property
    def ifrc_smooth(self) -> F64: ...
    @property
    def island_dofadr(self) -> I32: ...
    @property
    def island_idofadr(self) -> I32: ...
    @property
    def island_iefcadr(self) -> I32: ...
    @property
    def island_itreeadr(self) -> I32: ...
    @property
    def island_ne(self) -> I32: ...
    @property
    def island_nefc(self) -> I32: ...
    @property
    def island_nf(self) -> I32: ...
    @property
    def island_ntree(self) -> I32: ...
    @property
    def island_nv(self) -> I32: ...
    light_xdir: F64Field
    light_xpos: F64Field
    @property
    def map_dof2idof(self) -> I32: ...
    @property
    def map_efc2iefc(self) -> I32: ...
    @property
    def map_idof2dof(self) -> I32: ...
    @property
    def map_iefc2efc(self) -> I32: ...
    @property
    def map_itree2tree(self) -> I32: ...
    maxuse_arena: IntField
    maxuse_con: IntField
    maxuse_efc: IntField
    maxuse_stack: IntField
    mocap_pos: F64Field
    mocap_quat: F64Field
    @property
    def model(self) -> MjModel: ...
    moment_colind: I32Field
    moment_rowadr: I32Field
    moment_rownnz: I32Field
    nA: IntField
    nJ: IntField
    nY: IntField
    narena: IntField
    nbody_awake: IntField
    nbuffer: IntField
    ncon: IntField
    ne: IntField
    nefc: IntField
    nefmA: IntField
    nefmK: IntField
    nefmL: IntField
    nefmT: IntField
    nefmcon: IntField
    nefmdof: IntField
    nf: IntField
    nidof: IntField
    nisland: IntField
    nl: IntField
    nparent_awake: IntField
    nplugin: IntField
    ntree_awake: IntField
    nv_awake: IntField
    parena: IntField
    parent_awake_ind: I32Field
    pbase: IntField
    plastic: F64Field
    plugin: I32Field
    @property
    def plugin_data(self) -> npt.NDArray[np.uint64]: ...
    @plugin_data.setter
    def plugin_data(self, value: Any, /) -> None: ...
    plugin_state: F64Field
    pstack: IntField
    qDeriv: F64Field
    qH: F64Field
    qHDiagInv: F64Field
    qLD: F64Field
    qLDiagInv: F64Field
    qLU: F64Field
    qacc: F64Field
    qacc_smooth: F64Field
    qacc_warmstart: F64Field
    qfrc_actuator: F64Field
    qfrc_adhesion: F64Field
    qfrc_applied: F64Field
    qfrc_bias: F64Field
    qfrc_constraint: F64Field
    qfrc_damper: F64Field
    qfrc_fluid: F64Field
    qfrc_gravcomp: F64Field
    qfrc_inverse: F64Field
    qfrc_passive: F64Field
    qfrc_smooth: F64Field
    qfrc_spring: F64Field
    qpos: F64Field
    qvel: F64Field
    sensordata: F64Field
    @property
    def signature(self) -> int: ...
    site_xmat: F64Field
    site_xpos: F64Field
    site_xquat: F64Field
    @property
    def solver(self) -> _MjSolverStatList: ...
    solver_fwdinv: F64Field
    solver_niter: I32Field
    solver_nnz: I32Field
    subtree_angmom: F64Field
    subtree_com: F64Field
    subtree_linvel: F64Field
    ten_J: F64Field
    ten_length: F64Field
    ten_velocity: F64Field
    ten_wrapadr: I32Field
    ten_wrapnum: I32Field
    @property
    def tendon_efcadr(self) -> I32: ...
    threadpool: IntField
    time: FloatField
    @property
    def timer(self) -> _MjTimerStatList: ...
    tree_asleep: I32Field
    tree_awake: I32Field
    @property
    def tree_island(self) -> I32: ...
    userdata: F64Field
    @property
    def warning(self) -> _MjWarningStatList: ...
    wrap_obj: I32Field
    wrap_xpos: F64Field
    xanchor: F64Field
    xaxis: F64Field
    xfrc_applied: F64Field
    ximat: F64Field
    xipos: F64Field
    xiquat: F64Field
    xmat: F64Field
    xpos: F64Field
    xquat: F64Field

class _MjDataActuatorViews:
    ctrl: F64Field
    force: F64Field
    @property
    def id(self) -> int: ...
    length: F64Field
    @property
    def moment(self) -> F64: ...
    @property
    def name(self) -> str: ...
    velocity: F64Field

class _MjDataBodyViews:
    cacc: F64Field
    cfrc_ext: F64Field
    cfrc_int: F64Field
    cinert: F64Field
    crb: F64Field
    cvel: F64Field
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    subtree_angmom: F64Field
    subtree_com: F64Field
    subtree_linvel: F64Field
    xfrc_applied: F64Field
    ximat: F64Field
    xipos: F64Field
    xiquat: F64Field
    xmat: F64Field
    xpos: F64Field
    xquat: F64Field

class _MjDataCameraViews:
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    xmat: F64Field
    xpos: F64Field

class _MjDataGeomViews:
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    xmat: F64Field
    xpos: F64Field
    xquat: F64Field

class _MjDataJointViews:
    cdof: F64Field
    cdof_dot: F64Field
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    plastic: F64Field
    qLDiagInv: F64Field
    qacc: F64Field
    qacc_smooth: F64Field
    qacc_warmstart: F64Field
    qfrc_actuator: F64Field
    qfrc_applied: F64Field
    qfrc_bias: F64Field
    qfrc_constraint: F64Field
    qfrc_inverse: F64Field
    qfrc_passive: F64Field
    qfrc_smooth: F64Field
    qpos: F64Field
    qvel: F64Field
    xanchor: F64Field
    xaxis: F64Field

class _MjDataLightViews:
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    xdir: F64Field
    xpos: F64Field

class _MjDataSensorViews:
    data: F64Field
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...

class _MjDataSiteViews:
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    xmat: F64Field
    xpos: F64Field
    xquat: F64Field

class _MjDataTendonViews:
    @property
    def id(self) -> int: ...
    length: F64Field
    @property
    def name(self) -> str: ...
    plastic: F64Field
    velocity: F64Field
    wrapadr: I32Field
    wrapnum: I32Field

class MjStatistic:
    def __init__(self) -> None: ...
    center: F64Field
    extent: FloatField
    meaninertia: FloatField
    meanmass: FloatField
    meansize: FloatField

class MjLROpt:
    def __init__(self) -> None: ...
    accel: FloatField
    interval: FloatField
    inttotal: FloatField
    maxforce: FloatField
    mode: IntField
    timeconst: FloatField
    timestep: FloatField
    tolrange: FloatField
    useexisting: IntField
    uselimit: IntField

class MjrRect:
    def __init__(self, left: Int, bottom: Int, width: Int, height: Int) -> None: ...
    bottom: IntField
    height: IntField
    left: IntField
    width: IntField

class MjrVertexAttribute:
    def __init__(self, usage: Int = 0, type: Int = 0) -> None: ...
    usage: IntField
    type: IntField

class MjvPerturb:
    def __init__(self) -> None: ...
    active: IntField
    active2: IntField
    flexselect: IntField
    localmass: FloatField
    localpos: F64Field
    refpos: F64Field
    refquat: F64Field
    refselpos: F64Field
    scale: FloatField
    select: IntField
    skinselect: IntField

class MjvCamera:
    def __init__(self) -> None: ...
    azimuth: FloatField
    distance: FloatField
    elevation: FloatField
    fixedcamid: IntField
    lookat: F64Field
    orthographic: IntField
    trackbodyid: IntField
    type: IntField

class MjvGLCamera:
    def __init__(self) -> None: ...
    forward: F32Field
    frustum_bottom: FloatField
    frustum_center: FloatField
    frustum_far: FloatField
    frustum_near: FloatField
    frustum_top: FloatField
    frustum_width: FloatField
    orthographic: IntField
    pos: F32Field
    up: F32Field

class MjvGeom:
    label: str
    def __init__(self) -> None: ...
    camdist: FloatField
    castshadow: IntField
    category: IntField
    dataid: IntField
    emission: FloatField
    mat: F32Field
    matid: IntField
    modelrbound: FloatField
    objid: IntField
    objtype: IntField
    pos: F32Field
    reflectance: FloatField
    rgba: F32Field
    segid: IntField
    shininess: FloatField
    size: F32Field
    specular: FloatField
    texcoord: IntField
    texid: IntField
    texrepeat: F32Field
    texuniform: IntField
    transparent: IntField
    type: IntField

class MjvLight:
    def __init__(self) -> None: ...
    ambient: F32Field
    attenuation: F32Field
    bulbradius: FloatField
    castshadow: IntField
    cutoff: FloatField
    diffuse: F32Field
    dir: F32Field
    exponent: FloatField
    headlight: IntField
    id: IntField
    intensity: FloatField
    pos: F32Field
    softness: FloatField
    specular: F32Field
    texid: IntField
    range: FloatField
    type: IntField

class MjvOption:
    def __init__(self) -> None: ...
    actuatorgroup: U8Field
    bvh_depth: IntField
    flags: U8Field
    flex_layer: IntField
    flexgroup: U8Field
    frame: IntField
    geomgroup: U8Field
    jointgroup: U8Field
    label: IntField
    sitegroup: U8Field
    skingroup: U8Field
    tendongroup: U8Field

class MjvScene:
    @overload
    def __init__(self) -> None: ...
    @overload
    def __init__(self, model: MjModel, maxgeom: Int) -> None: ...
    @property
    def camera(self) -> tuple[Any, ...]: ...
    enabletransform: IntField
    flags: U8Field
    flexedge: I32Field
    flexedgeadr: I32Field
    flexedgenum: I32Field
    flexedgeopt: IntField
    flexface: F32Field
    flexfaceadr: I32Field
    flexfacenum: I32Field
    flexfaceopt: IntField
    flexfaceused: I32Field
    flexnormal: F32Field
    flexskinopt: IntField
    flextexcoord: F32Field
    flexvert: F32Field
    flexvertadr: I32Field
    flexvertnum: I32Field
    flexvertopt: IntField
    framergb: F32Field
    framewidth: IntField
    geomorder: I32Field
    @property
    def geoms(self) -> tuple[Any, ...]: ...
    @property
    def lights(self) -> tuple[Any, ...]: ...
    maxgeom: IntField
    nflex: IntField
    ngeom: IntField
    nlight: IntField
    nskin: IntField
    rotate: F32Field
    scale: FloatField
    skinfacenum: I32Field
    skinnormal: F32Field
    skinvert: F32Field
    skinvertadr: I32Field
    skinvertnum: I32Field
    status: IntField
    stereo: IntField
    translate: F32Field

class MjvFigure:
    minwidth: str
    title: str
    xformat: str
    xlabel: str
    yformat: str
    def __init__(self) -> None: ...
    figurergba: F32Field
    flg_barplot: IntField
    flg_extend: IntField
    flg_legend: IntField
    flg_selection: IntField
    flg_symmetric: IntField
    flg_ticklabel: I32Field
    gridrgb: F32Field
    gridsize: I32Field
    gridwidth: FloatField
    highlight: I32Field
    highlightid: IntField
    legendoffset: IntField
    legendrgba: F32Field
    linedata: F32Field
    @property
    def linename(self) -> npt.NDArray[Any]: ...
    linepnt: I32Field
    linergb: F32Field
    linewidth: FloatField
    panergba: F32Field
    selection: FloatField
    subplot: IntField
    textrgb: F32Field
    xaxisdata: F32Field
    xaxispixel: I32Field
    yaxisdata: F32Field
    yaxispixel: I32Field
    range: F32Field

def mjv_averageCamera(cam1: MjvGLCamera, cam2: MjvGLCamera) -> MjvGLCamera: ...
def mjv_camera2GLCamera(m: MjModel, d: MjData, cam: MjvCamera) -> MjvGLCamera: ...
