"""Joints of an arm that a file ties to each other are refused; what ties a gripper is not."""

from pathlib import Path

import pytest

from robo47_qp.errors import ModelError
from robo47_qp.model.arm import Arm
from robo47_qp.model.loading import robot_from_mjcf

TELESCOPE = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="mast"><site name="foot"/>
    <joint name="lift" type="slide" axis="0 0 1" range="0 1"/><geom size="0.05"/>
    <body name="inner" pos="0.1 0 0"><joint name="in" type="slide" axis="1 0 0" range="0 0.3"/>
      <geom size="0.04"/>
      <body name="outer" pos="0.1 0 0"><joint name="out" type="slide" axis="1 0 0" range="0 0.3"/>
        <geom size="0.03"/>
        <body name="hand" pos="0.1 0 0"><joint name="wrist" axis="0 0 1" range="-3 3"/>
          <geom size="0.02"/><site name="tcp" pos="0.05 0 0"/>
        </body>
      </body>
    </body>
  </body>
</worldbody>
<tendon><fixed name="both">
  <joint joint="in" coef="1"/><joint joint="out" coef="-1"/>
</fixed></tendon>
<equality>%s</equality></mujoco>"""
ALL = ["lift", "in", "out", "wrist"]


def arm_with(folder: Path, tie: str, joints: list[str]) -> Arm:
    file = folder / "telescope.xml"
    file.write_text(TELESCOPE % tie, encoding="utf-8")
    return Arm(robot_from_mjcf(file, tcp="tcp", home=[0.1] * len(joints), joints=joints))


@pytest.mark.parametrize(
    ("tie", "joints", "found"),
    [
        ('<joint joint1="out" joint2="in"/>', ALL, "kind joint that ties in, out"),
        ('<joint joint1="out" joint2="in"/>', ALL[:3], "kind joint that ties in, out"),
        ('<joint joint1="wrist"/>', ALL, "kind joint that ties wrist"),
        ('<tendon tendon1="both"/>', ALL, "kind tendon that ties in, out"),
        ('<connect body1="outer" body2="mast" anchor="0 0 0"/>', ALL, "connect that ties in, out"),
        ('<weld body1="hand"/>', ALL, "kind weld that ties lift, in, out, wrist"),
        ('<connect site1="tcp" site2="foot"/>', ALL, "connect that ties in, out, wrist"),
    ],
)
def test_joints_that_are_tied_are_named(
    tmp_path: Path, tie: str, joints: list[str], found: str
) -> None:
    """Also where another joint of the file is welded, which takes its equalities out."""
    with pytest.raises(ModelError, match=found):
        arm_with(tmp_path, tie, joints)


@pytest.mark.parametrize(
    ("tie", "joints"),
    [
        ("", ALL),
        ('<joint joint1="out" joint2="in" active="false"/>', ALL),
        ('<joint joint1="out" joint2="in"/>', ["lift", "in", "wrist"]),
        ('<tendon tendon1="both"/>', ["lift", "in", "wrist"]),
    ],
)
def test_what_ties_nothing_of_the_arm_is_left(tmp_path: Path, tie: str, joints: list[str]) -> None:
    assert arm_with(tmp_path, tie, joints).n == len(joints)
