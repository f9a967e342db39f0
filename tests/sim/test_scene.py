"""The compiled world: physics options, names, and what must lie side by side."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import ModelError, UnknownNameError
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.sim.contact import contact_sensor
from robo47_qp.sim.scene import compile_scene, free_bodies, mocap_bodies
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.robots import GRIPPER
from tests.runs import no_objects


def three_bodies(spec: mujoco.MjSpec) -> None:
    for name, kind in (("ghost", "mocap"), ("ball", "free"), ("post", "fixed"), ("die", "free")):
        body = spec.worldbody.add_body(name=name, pos=[0.5, 0.1, 0.5], mocap=kind == "mocap")
        if kind == "free":
            body.add_freejoint()
        body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], mass=0.1)
    ghost = spec.worldbody.add_body(name="second ghost", mocap=True)
    ghost.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0])


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return compile_scene(PANDA, three_bodies)


def test_the_period_is_one_millisecond(model: mujoco.MjModel) -> None:
    assert TIMESTEP == 1e-3
    assert model.opt.timestep == TIMESTEP


def test_what_touches_a_finger_hardly_is_pushed_away_from_it() -> None:
    """At MuJoCo's own tolerance, half of these cylinders were pulled in."""

    def beside_a_box(spec: mujoco.MjSpec) -> None:
        kinds = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
        for kind, size in zip(kinds, ([0.01, 0.004, 0.01], [0.016, 0.03, 0.0]), strict=True):
            body = spec.worldbody.add_body(name=kind.name, pos=[0.5, 0.4, 0.5])
            body.add_freejoint()
            body.add_geom(name=kind.name, type=kind, size=size, mass=0.1)

    m = compile_scene(PANDA, beside_a_box)
    d, rng = mujoco.MjData(m), np.random.default_rng(0)
    cylinder = m.geom("mjGEOM_CYLINDER").id
    start = int(m.body("mjGEOM_CYLINDER").jntadr[0])
    place = d.qpos[m.jnt_qposadr[start] :][:7]
    for depth in np.geomspace(1e-8, 1e-5, 300):
        tilt = [1.0, *rng.normal(0.0, 1e-5, 3)]
        place[:] = [0.5 + rng.uniform(-1e-3, 1e-3), 0.42 - depth, 0.5, *tilt]
        mujoco.mj_forward(m, d)
        normals = {
            g[1] == cylinder: n[1]
            for g, n in zip(d.contact.geom, d.contact.frame, strict=True)
            if cylinder in g
        }
        assert normals
        assert all(n > 0.99 if second else n < -0.99 for second, n in normals.items())


def test_free_and_mocap_bodies_are_found_in_their_order(model: mujoco.MjModel) -> None:
    assert free_bodies(model) == ("ball", "die")
    assert mocap_bodies(model) == ("ghost", "second ghost")
    for i, name in enumerate(mocap_bodies(model)):
        assert model.body(name).mocapid == i


def test_a_world_without_objects_has_none() -> None:
    bare = compile_scene(PANDA, no_objects)
    assert free_bodies(bare) == ()
    assert mocap_bodies(bare) == ()


def test_gravity_is_the_earths(model: mujoco.MjModel) -> None:
    np.testing.assert_allclose(model.opt.gravity, [0.0, 0.0, -9.81])


def test_the_sensor_of_a_finger_is_the_sum_of_its_contact_forces(model: mujoco.MjModel) -> None:
    """A ball pressed against one finger; the force from MuJoCo, contact by contact."""
    data = mujoco.MjData(model)
    finger = GRIPPER.fingers[0]
    data.qpos[: len(PANDA.home)] = PANDA.home
    data.joint("finger_joint1").qpos = 0.02
    mujoco.mj_forward(model, data)
    ball = model.body("ball")
    address = model.jnt_qposadr[ball.jntadr[0]]
    data.qpos[address : address + 3] = data.geom("left_pad").xpos + np.array([0.0, 0.0135, 0.0])
    mujoco.mj_forward(model, data)
    total = np.zeros(3)
    for i in range(data.ncon):
        contact = data.contact[i]
        bodies = [model.body(model.geom_bodyid[geom]).name for geom in contact.geom]
        wrench = np.zeros(6)
        mujoco.mj_contactForce(model, data, i, wrench)
        sign = -1.0 if bodies[0] == finger else 1.0
        if finger in bodies:
            total += sign * contact.frame.reshape(3, 3).T @ wrench[:3]
    assert np.linalg.norm(total) > 1.0
    measured = data.sensor(contact_sensor(finger)).data
    assert np.linalg.norm(measured) == pytest.approx(np.linalg.norm(total), rel=1e-6)
    assert not data.sensor(contact_sensor(GRIPPER.fingers[1])).data.any()


def test_the_actuator_limits_of_the_model_are_those_of_the_description(
    model: mujoco.MjModel,
) -> None:
    for motor, limit in zip(PANDA.motors, PANDA.tau_max, strict=True):
        assert model.actuator(motor).forcerange[1] == limit


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        ({"joints": (*PANDA.joints[:-1], "elbow")}, "joint"),
        ({"motors": (*PANDA.motors[:-1], "elbow")}, "motor"),
        ({"tcp": "elbow"}, "site"),
        ({"gripper": replace(GRIPPER, joints=("finger_joint1", "elbow"))}, "joint"),
        ({"gripper": replace(GRIPPER, fingers=("elbow", "right_finger"))}, "body"),
        ({"gripper": replace(GRIPPER, actuator="elbow")}, "motor"),
    ],
)
def test_a_name_that_the_model_lacks_is_told_with_those_it_has(
    change: dict[str, object], kind: str
) -> None:
    robot = replace(PANDA, **change)  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match=f"No {kind} is called 'elbow'; known: .") as caught:
        compile_scene(robot, no_objects)
    assert caught.value.known


@pytest.mark.parametrize("what", ["joints", "motors"])
def test_joints_and_motors_out_of_order_are_refused(what: str) -> None:
    names = getattr(PANDA, what)
    swapped = (names[1], names[0], *names[2:])
    change = {what: swapped}
    robot = replace(PANDA, **change)  # type: ignore[arg-type]
    with pytest.raises(ModelError, match=f"The {what} of robot 'panda' have the ids"):
        compile_scene(robot, no_objects)


def test_the_main_job_compiles_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    model = compile_scene(PANDA, PickPlace().build_scene)
    assert free_bodies(model) == ("cube",)
    assert mocap_bodies(model) == ("goal",)
    assert model.camera("overview").id >= 0


def test_a_world_that_is_not_drawn_moves_the_same_to_the_bit() -> None:
    """With the hand on the item: contacts come in the same order."""
    worlds = [compile_scene(PANDA, PickPlace().build_scene, drawn=drawn) for drawn in (True, False)]
    assert worlds[1].ngeom < worlds[0].ngeom - 50
    ends = []
    for m in worlds:
        d = mujoco.MjData(m)
        d.qpos[:7] = PANDA.home
        d.qpos[m.jnt_qposadr[m.body("cube").jntadr[0]] :][:3] = 0.41, 0.03, 0.1
        touched = 0
        for k in range(1500):
            d.ctrl[:7] = d.qfrc_bias[:7] + 8.0 * np.sin(5e-3 * k + np.arange(7))
            mujoco.mj_step(m, d)
            touched += d.ncon
        assert touched > 1000
        ends.append(np.concatenate([d.qpos, d.qvel, d.sensordata]))
    np.testing.assert_array_equal(ends[0], ends[1])
