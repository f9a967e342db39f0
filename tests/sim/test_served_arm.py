"""What a served arm tells of forces, by libfranka's signs."""

import mujoco
import numpy as np
from mink import SE3, SO3

from robo47_qp.model.arm import bare_arm
from robo47_qp.model.robots import load_robot
from robo47_qp.sim.franka.served_arm import ServedArm
from robo47_qp.sim.simulation import Simulation

FR3 = load_robot("fr3")


def add_plate(spec: mujoco.MjSpec) -> None:
    plate = spec.worldbody.add_body(name="plate", mocap=True, pos=[0.0, 0.0, -1.0])
    plate.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.01])


def pressed_from_below(force: float) -> ServedArm:
    """An arm at rest with a plate that presses against the tips of its fingers."""
    simulation = Simulation(FR3, add_plate)
    served = ServedArm(simulation)
    served.set_frames(T_ee_k=SE3.from_rotation(SO3.from_x_radians(np.pi / 2)))
    x, y, z = simulation.tool_pose().translation()
    height = z - 0.03
    while simulation.last_tool_force()[2] < force:
        height += 1e-6 if simulation.last_tool_force().any() else 1e-5
        assert height < z + 0.01
        simulation.place_marker("plate", SE3.from_translation(np.array([x, y, height])))
        served.advance(None)
    for _ in range(2000):
        served.advance(None)
    return served


def test_forces_of_the_robot_on_others_are_positive() -> None:
    served = pressed_from_below(8.0)
    served.packed(1)
    told = {name: served._state[name] for name in ("tau_J", "tau_ext", "O_F_ext", "K_F_ext")}
    # The plate pushes the tool up, so the robot pushes it down.
    assert told["O_F_ext"][2] < -2.0
    # libfranka: tau_ext_hat_filtered is the error between tau_J and the expected torques.
    q, v = served.sim.true_state()
    expected = bare_arm(FR3).inverse_dynamics(q, v, np.zeros(7))
    np.testing.assert_allclose(told["tau_ext"], told["tau_J"] - expected, atol=0.1)
    assert np.abs(told["tau_ext"]).max() > 0.5
    # The stiffness frame is the tool's, which looks down, turned by a quarter about its x.
    R = served.sim.tool_pose().rotation().as_matrix() @ SO3.from_x_radians(np.pi / 2).as_matrix()
    np.testing.assert_allclose(told["K_F_ext"][:3], R.T @ told["O_F_ext"][:3], atol=1e-4)
