"""Unmodified pylibfranka against the server, in lock-step: what holds here holds to the bit."""

import signal
import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import pytest

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots import load_robot
from robo47_qp.sim.franka.protocol import COMMAND, ERRORS, Command
from robo47_qp.sim.franka.server import FrankaServer
from robo47_qp.sim.simulation import Simulation
from tests.franka import served

franka = pytest.importorskip("pylibfranka", reason="the extra franka is not installed")
FR3 = load_robot("fr3")
MODE = franka.ControllerMode.JointImpedance
STEPS = 120


@pytest.fixture(scope="module")
def host() -> Iterator[str]:
    with served("--lock-step") as (host, _):
        yield host


@pytest.fixture
def robot(host: str) -> Any:
    return franka.Robot(host, franka.RealtimeConfig.kIgnore)


def blend(i: int, steps: int = STEPS) -> float:
    s = i / steps
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def speeds(way: float) -> list[float]:
    """The speed in every period of a way from rest to rest."""
    return [1e3 * way * (blend(i + 1) - blend(i)) for i in range(STEPS)] + [0.0]


def run(control: Any, command: Callable[[int, Any], Any], steps: int = STEPS) -> list[Any]:
    """Send commands i = 0 … steps, the last one as the end of the motion; return the states."""
    states = []
    for i in range(steps + 1):
        state, _ = control.readOnce()
        states.append(state)
        now = command(i, state)
        now.motion_finished = i == steps
        control.writeOnce(now)
    return states


def test_a_state_is_that_of_the_model(robot: Any) -> None:
    arm, state = Arm(FR3), robot.read_once()
    q = np.array(state.q)
    np.testing.assert_allclose(q, FR3.home, atol=1e-6)
    T = np.array(state.O_T_EE).reshape(4, 4).T
    np.testing.assert_allclose(T, arm.pose(q).as_matrix(), atol=1e-6)
    assert state.robot_mode == franka.RobotMode.Idle
    assert not state.current_errors
    # pinocchio, in libfranka, of the description that the server gives, with the hand it tells of.
    model = robot.load_model()
    np.testing.assert_allclose(model.gravity(state), state.tau_J, atol=2e-3)
    still = np.zeros(7)
    np.testing.assert_allclose(
        model.gravity(state), arm.inverse_dynamics(q, still, still), atol=2e-3
    )
    turned = np.array(model.zero_jacobian(state)).reshape(7, 6).T
    R = arm.pose(q).rotation().as_matrix()
    J = arm.jacobian(q)
    np.testing.assert_allclose(turned, np.vstack([R @ J[:3], R @ J[3:]]), atol=1e-5)


@pytest.mark.parametrize(
    ("commanded", "measured", "start", "kind", "way"),
    [
        ("q_d", "q", "start_joint_position_control", franka.JointPositions, {1: 0.01, 6: 0.02}),
        (
            "O_T_EE_c",
            "O_T_EE",
            "start_cartesian_pose_control",
            franka.CartesianPose,
            {12: 0.004, 13: -0.003, 14: 0.005},
        ),
    ],
    ids=["joints", "tool"],
)
def test_positions_are_followed(
    robot: Any, commanded: str, measured: str, start: str, kind: Any, way: dict[int, float]
) -> None:
    first = np.array(getattr(robot.read_once(), commanded))
    whole = np.zeros(len(first))
    whole[list(way)] = list(way.values())
    run(getattr(robot, start)(MODE), lambda i, _: kind((first + blend(i) * whole).tolist()))
    state = robot.read_once()
    np.testing.assert_allclose(getattr(state, commanded), first + whole, atol=1e-6)
    np.testing.assert_allclose(getattr(state, measured), first + whole, atol=1e-3)


def test_joint_velocities_are_followed(robot: Any) -> None:
    start = np.array(robot.read_once().q_d)
    rates = speeds(0.02)

    def command(i: int, _: Any) -> Any:
        return franka.JointVelocities([0.0] * 6 + [rates[i]])

    run(robot.start_joint_velocity_control(MODE), command)
    assert robot.read_once().q_d[6] == pytest.approx(start[6] + 0.02, abs=1e-6)


def test_tool_velocities_are_followed(robot: Any) -> None:
    start = np.array(robot.read_once().O_T_EE_c)
    rates = speeds(0.004)

    def command(i: int, _: Any) -> Any:
        return franka.CartesianVelocities([0.0, rates[i], 0.0, 0.0, 0.0, 0.0])

    run(robot.start_cartesian_velocity_control(MODE), command)
    there = np.array(robot.read_once().O_T_EE_c)
    np.testing.assert_allclose(there[12:15] - start[12:15], [0.0, 0.004, 0.0], atol=1e-5)


def held(_: int, state: Any) -> Any:
    """Torques of a spring to home: gravity is the robot's."""
    spring = 200.0 * (FR3.home - state.q) - 20.0 * np.array(state.dq)
    return franka.Torques((spring * [1, 1, 1, 1, 0.2, 0.2, 0.1]).tolist())


def test_torques_come_without_gravity_and_two_runs_are_equal(host: str) -> None:
    runs = []
    for _ in range(2):
        states = run(franka.Robot(host, franka.RealtimeConfig.kIgnore).start_torque_control(), held)
        runs.append(np.array([[*s.q, *s.dq, *s.tau_J] for s in states]))
        np.testing.assert_allclose(states[-1].q, FR3.home, atol=1e-4)
        assert states[-1].control_command_success_rate == 1.0
    np.testing.assert_array_equal(runs[0], runs[1])


def idle(_: int, __: Any) -> Any:
    return franka.Torques([0.0] * 7)


def ramped(joint: int, height: float) -> Callable[[int, Any], Any]:
    """A torque of one joint that rises at half of the rate that is allowed."""
    return lambda i, _: franka.Torques(
        [min(0.5 * i, height) if j == joint else 0.0 for j in range(7)]
    )


def jumping(kind: Callable[[Any], Any], at: Callable[[Any], list[float]], size: float) -> Any:
    """Positions or poses that stay, then move by a size in one period."""
    first: list[list[float]] = []

    def command(i: int, state: Any) -> Any:
        first[:] = first or [list(at(state))]
        moved = list(first[0])
        moved[12 if len(moved) == 16 else 3] += size if i == 5 else 0.0
        return kind(moved)

    return command


@pytest.mark.parametrize(
    ("name", "start", "command"),
    [
        (
            "controller_torque_discontinuity",
            lambda robot: robot.start_torque_control(),
            lambda i, _: franka.Torques([0.0, 0.0, 5.0 * (i == 5), 0.0, 0.0, 0.0, 0.0]),
        ),
        ("tau_J_range_violation", lambda r: r.start_torque_control(), ramped(6, 15.0)),
        ("joint_velocity_violation", lambda r: r.start_torque_control(), ramped(5, 9.0)),
        (
            "joint_motion_generator_velocity_discontinuity",
            lambda robot: robot.start_joint_position_control(MODE),
            jumping(franka.JointPositions, lambda s: s.q_d, 1e-4),
        ),
        (
            "joint_motion_generator_velocity_limits_violation",
            lambda robot: robot.start_joint_position_control(MODE),
            jumping(franka.JointPositions, lambda s: s.q_d, 0.1),
        ),
        (
            "joint_position_motion_generator_start_pose_invalid",
            lambda robot: robot.start_joint_position_control(MODE),
            lambda _, s: franka.JointPositions((np.array(s.q_d) + 0.1).tolist()),
        ),
        (
            "cartesian_motion_generator_velocity_discontinuity",
            lambda robot: robot.start_cartesian_pose_control(MODE),
            jumping(franka.CartesianPose, lambda s: s.O_T_EE_c, 1e-4),
        ),
    ],
)
def test_what_is_refused_has_the_name_of_libfranka(
    robot: Any, name: str, start: Callable[[Any], Any], command: Callable[[int, Any], Any]
) -> None:
    assert name in ERRORS
    with pytest.raises(franka.ControlException, match=rf'reflex! \["{name}"\]'):
        run(start(robot), command, 400)
    state = robot.read_once()
    assert state.robot_mode == franka.RobotMode.Reflex
    assert str(state.current_errors) == f'["{name}"]'
    with pytest.raises(franka.CommandException, match="command not possible"):
        start(robot)
    robot.automatic_error_recovery()
    assert robot.read_once().robot_mode == franka.RobotMode.Idle
    run(robot.start_torque_control(), idle, 5)


def test_the_hand_moves_and_tells_of_no_grasp_in_the_air(host: str) -> None:
    robot, hand = franka.Robot(host, franka.RealtimeConfig.kIgnore), franka.Gripper(host)
    assert hand.move(0.06, 0.1)
    assert hand.read_once().width == pytest.approx(0.06, abs=1e-4)
    assert not hand.grasp(0.04, 0.1, 20.0)
    assert hand.read_once().width == pytest.approx(0.0, abs=1e-3)
    assert not hand.read_once().is_grasped
    with pytest.raises(franka.CommandException, match="Command failed"):
        hand.move(0.2, 0.1)
    assert robot.read_once().q[0] == pytest.approx(FR3.home[0], abs=1e-6)


def test_a_load_is_borne(robot: Any) -> None:
    """The weight of a load is in the torques of the robot, as pinocchio in libfranka says."""
    robot.set_load(1.0, [0.01, 0.0, 0.05], [1e-3, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 1e-3])
    states = run(robot.start_torque_control(), idle, 10)
    wanted = robot.load_model().gravity(states[-1])
    np.testing.assert_allclose(states[-1].tau_J, wanted, atol=0.02)
    still = np.zeros(7)
    unloaded = Arm(FR3).inverse_dynamics(np.array(states[-1].q), still, still)
    assert abs(wanted[1] - unloaded[1]) > 2.0


@pytest.mark.parametrize(
    "rubbish",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        struct.pack("<III", 99, 0, 12),
        struct.pack("<III", 0, 0, 1 << 30),
        struct.pack("<III", 1, 0, 12),
    ],
    ids=["http", "unknown", "a gigabyte", "no body"],
)
def test_rubbish_ends_its_own_connection(host: str, rubbish: bytes) -> None:
    with socket.create_connection((host, 1337), timeout=5.0) as connection:
        connection.sendall(rubbish)
        connection.shutdown(socket.SHUT_WR)
        with suppress(ConnectionResetError):
            while connection.recv(100):
                pass
    robot = franka.Robot(host, franka.RealtimeConfig.kIgnore)
    assert robot.read_once().robot_mode == franka.RobotMode.Idle


def test_it_ends_by_a_signal_and_binds_what_it_is_told() -> None:
    with served("--task", "reach") as (host, process):
        states = franka.Robot(host, franka.RealtimeConfig.kIgnore)
        assert states.read_once().time.to_sec() > 0.0
        process.send_signal(signal.SIGTERM)
        assert process.wait(5.0) == 0
        with pytest.raises(OSError, match="refused"):
            socket.create_connection((host, 1337), timeout=1.0)


def test_an_address_of_another_machine_is_refused() -> None:
    simulation = Simulation(FR3, lambda _: None)
    with (
        pytest.raises(InvalidValueError, match="an address of this machine"),
        FrankaServer(simulation, simulation.reset, "192.0.2.1"),
    ):
        pass


def test_only_arms_with_seven_joints_are_served() -> None:
    simulation = Simulation(load_robot("ur5e"), lambda _: None)
    with pytest.raises(InvalidValueError, match="seven joints"):
        FrankaServer(simulation, simulation.reset)


@contextmanager
def introduced(host: str) -> Iterator[tuple[socket.socket, socket.socket]]:
    """A client without libfranka: its connection, and where states come in."""
    with (
        socket.create_connection((host, 1337), timeout=5.0) as connection,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as states,
    ):
        states.settimeout(5.0)
        states.bind(("127.0.0.1", 0))
        hello = struct.pack("<HH", 10, states.getsockname()[1])
        connection.sendall(struct.pack("<III", 0, 0, 16) + hello)
        assert connection.recv(100)[12] == 0
        yield connection, states


def test_a_command_that_is_no_number_ends_the_connection(host: str) -> None:
    """libfranka refuses to send it, so it comes from a socket."""
    with introduced(host) as (connection, states):
        connection.sendall(
            struct.pack("<III", 1, 1, 125) + struct.pack("<II6d?7d", 2, 4, *[0.0] * 14)
        )
        assert connection.recv(100)[12] == 1
        command = np.zeros((), COMMAND)
        command["id"], command["tau"] = 1 << 40, np.nan
        _, server = states.recvfrom(2000)
        states.sendto(command.tobytes(), server)
        assert not connection.recv(100)
    assert franka.Robot(host, franka.RealtimeConfig.kIgnore).read_once().q[0] == 0.0


def test_a_state_of_after_a_request_is_there_with_its_answer(host: str) -> None:
    """What was sent before may tell of an error from which the robot has recovered."""
    with introduced(host) as (connection, states):
        for number in range(1, 21):
            states.recv(2000)
            states.setblocking(False)
            with suppress(BlockingIOError):
                while states.recv(2000):
                    pass
            connection.sendall(struct.pack("<III", Command.AUTOMATIC_ERROR_RECOVERY, number, 12))
            connection.settimeout(5.0)
            assert connection.recv(100)[12] == 0
            assert states.recv(2000)
            states.settimeout(5.0)
