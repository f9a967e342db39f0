"""What a scene knows of its free objects."""

import mujoco
import numpy as np

from robo47_qp.sim.objects import Inertia


def test_moments_are_those_about_the_axes_of_the_body() -> None:
    """MuJoCo keeps moments about principal axes, which lie askew in a body like this."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body name='bent'><freejoint/>"
        "<inertial pos='0.01 -0.02 0.03' mass='0.2' fullinertia='4e-4 5e-4 6e-4 1e-4 -5e-5 8e-5'/>"
        "</body></worldbody></mujoco>"
    )
    centre, moments = Inertia.of(model, "bent")
    np.testing.assert_array_equal(centre, [0.01, -0.02, 0.03])
    expected = [[4e-4, 1e-4, -5e-5], [1e-4, 5e-4, 8e-5], [-5e-5, 8e-5, 6e-4]]
    np.testing.assert_allclose(moments, expected, rtol=1e-9)
