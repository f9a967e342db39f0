from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mink import SE3, SO3
from numpy.typing import ArrayLike

from robo47_qp.errors import InvalidValueError
from robo47_qp.model.payload import Payload
from robo47_qp.motion.waypoint import Motion, Place, Waypoint, tool_down

NOWHERE = SE3.identity()


def payload(**changed: object) -> Payload:
    held: dict[str, object] = {"mass": 0.5, "inertia": (1e-3, 2e-3, 2.5e-3), "T_tcp_com": NOWHERE}
    return Payload(**{**held, **changed})  # type: ignore[arg-type]


@given(x=st.floats(-1, 1), y=st.floats(-1, 1), z=st.floats(-1, 1), yaw=st.floats(-7, 7))
def test_a_tool_that_points_down(x: float, y: float, z: float, yaw: float) -> None:
    R = tool_down([x, y, z], yaw).rotation().as_matrix()
    assert tool_down([x, y, z], yaw).translation() == pytest.approx([x, y, z], abs=1e-15)
    assert R[:, 2] == pytest.approx([0.0, 0.0, -1.0], abs=1e-12)
    assert R[:, 0] == pytest.approx([np.cos(yaw), np.sin(yaw), 0.0], abs=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_without_a_yaw_the_tool_has_the_x_axis_of_the_world() -> None:
    R = tool_down([0.4, 0.0, 0.2]).rotation().as_matrix()
    assert pytest.approx(np.diag([1.0, -1.0, -1.0]), abs=1e-12) == R


def test_a_tool_pose_does_not_change_with_the_array_it_was_made_of() -> None:
    position = np.array([0.1, 0.2, 0.3])
    pose = tool_down(position)
    position[:] = 9.0
    assert pose.translation().tolist() == [0.1, 0.2, 0.3]


@pytest.mark.parametrize(
    "position", [[0.0, 0.0], [0.0, 0.0, np.nan], [0.0, np.inf, 0.0], 1.0, "abc", [[0.0, 0.0, 0.0]]]
)
def test_a_tool_at_no_place_is_refused(position: ArrayLike) -> None:
    with pytest.raises(InvalidValueError, match="position must be a vector of 3 finite numbers"):
        tool_down(position)


@pytest.mark.parametrize("yaw", [np.nan, np.inf, -np.inf])
def test_a_yaw_that_is_not_finite_is_refused(yaw: float) -> None:
    with pytest.raises(InvalidValueError, match=r"yaw must be finite \[rad\]; found"):
        tool_down([0.0, 0.0, 0.0], yaw)


def test_a_waypoint_is_by_default_a_plain_ptp_motion_at_full_pace() -> None:
    waypoint = Waypoint(name="there", target=NOWHERE)
    assert waypoint.motion is Motion.PTP
    assert waypoint.pace == 1.0
    assert waypoint.grip is None
    assert waypoint.carried is None


def test_a_waypoint_may_be_a_place_of_the_robot() -> None:
    assert Waypoint(name="rest", target=Place.HOME).target is Place.HOME


@pytest.mark.parametrize("pace", [1e-6, 0.5, 1.0])
def test_a_pace_above_0_up_to_1_is_taken(pace: float) -> None:
    assert Waypoint(name="there", target=NOWHERE, pace=pace).pace == pace


@pytest.mark.parametrize("pace", [0.0, -0.1, 1.0001, np.nan, np.inf])
@pytest.mark.parametrize("target", [NOWHERE, Place.HOME])
def test_another_pace_is_refused(pace: float, target: SE3 | Place) -> None:
    message = "pace of waypoint 'there' must be above 0 and at most 1; found"
    with pytest.raises(InvalidValueError, match=message):
        Waypoint(name="there", target=target, pace=pace)


@pytest.mark.parametrize("entry", range(7))
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_target_with_a_hole_in_it_is_refused(entry: int, bad: float) -> None:
    numbers = NOWHERE.wxyz_xyz.copy()
    numbers[entry] = bad
    with pytest.raises(InvalidValueError, match="target of waypoint 'there' must be a vector of 7"):
        Waypoint(name="there", target=SE3(numbers))


@pytest.mark.parametrize(
    "quaternion", [(0, 0, 0, 0), (2, 0, 0, 0), (1, 1e-2, 0, 0), (0.999, 0, 0, 0)]
)
def test_a_target_without_a_unit_quaternion_is_refused(quaternion: tuple[float, ...]) -> None:
    message = "target of waypoint 'there' must be a pose with a unit quaternion; found"
    with pytest.raises(InvalidValueError, match=message):
        Waypoint(name="there", target=SE3(np.array([*quaternion, 0.0, 0.0, 0.0])))


@given(angle=st.floats(-10, 10))
def test_every_rotation_is_taken(angle: float) -> None:
    for turn in (SO3.from_x_radians, SO3.from_y_radians, SO3.from_z_radians):
        Waypoint(name="there", target=SE3.from_rotation(turn(angle)))


def test_a_waypoint_cannot_be_changed() -> None:
    waypoint = Waypoint(name="there", target=NOWHERE)
    with pytest.raises(FrozenInstanceError):
        waypoint.pace = 0.5  # type: ignore[misc]


@pytest.mark.parametrize("mass", [0.0, -1.0, np.nan, np.inf])
def test_a_mass_that_no_body_has_is_refused(mass: float) -> None:
    message = r"payload mass must be above 0 and finite; found"
    with pytest.raises(InvalidValueError, match=message):
        payload(mass=mass)


@given(
    sides=st.tuples(*[st.floats(1e-3, 1.0)] * 3),
    mass=st.floats(1e-3, 10.0),
    order=st.permutations(range(3)),
)
def test_every_box_is_a_payload(
    sides: tuple[float, float, float], mass: float, order: list[int]
) -> None:
    a, b, c = (sides[i] ** 2 for i in order)
    payload(mass=mass, inertia=(mass / 12 * (b + c), mass / 12 * (a + c), mass / 12 * (a + b)))


def test_a_flat_plate_and_a_thin_rod_are_payloads() -> None:
    payload(inertia=(1e-3, 1e-3, 2e-3))
    payload(inertia=(1e-12, 1e-3, 1e-3))


@pytest.mark.parametrize(
    "inertia", [(1.0, 1.0, 2.1), (5.0, 1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, -1.0)]
)
def test_moments_that_no_body_has_are_refused(inertia: tuple[float, float, float]) -> None:
    message = "payload inertia must be three positive moments, none above the sum of the others"
    with pytest.raises(InvalidValueError, match=message):
        payload(inertia=inertia)


@pytest.mark.parametrize("inertia", [(1.0, 1.0), (1.0, 1.0, np.nan), (np.inf, 1.0, 1.0), 1.0])
def test_moments_that_are_not_three_numbers_are_refused(inertia: ArrayLike) -> None:
    with pytest.raises(InvalidValueError, match="inertia must be three finite numbers"):
        payload(inertia=inertia)


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ([np.nan] * 7, "a vector of 7 finite numbers"),
        ([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.inf], "a vector of 7 finite numbers"),
        ([0.0] * 7, "a pose with a unit quaternion"),
        ([1.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "a pose with a unit quaternion"),
    ],
)
def test_a_payload_at_no_pose_is_refused(numbers: list[float], message: str) -> None:
    with pytest.raises(InvalidValueError, match=f"payload T_tcp_com must be {message}; found"):
        payload(T_tcp_com=SE3(np.array(numbers)))


@pytest.mark.parametrize("target", ["home", None, np.eye(4)])
def test_a_target_that_is_no_pose_is_refused(target: Any) -> None:
    told = r"target of waypoint 'x' must be a pose \(mink.SE3\), ToolPoses or a Place; found"
    with pytest.raises(InvalidValueError, match=told):
        Waypoint(name="x", target=target)


def test_what_follows_are_waypoints() -> None:
    with pytest.raises(InvalidValueError, match="onward of waypoint 'x' must be a sequence"):
        Waypoint(name="x", target=SE3.identity(), onward=(3,))  # type: ignore[arg-type]
