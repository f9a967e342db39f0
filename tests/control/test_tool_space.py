import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robo47_qp.control.tool_space import MASS_MAX, ToolSpace
from robo47_qp.model.arm import Arm
from tests.plain_arm import PlainArm

H = 1e-6


def world_jacobian(plain: PlainArm, q: np.ndarray) -> np.ndarray:
    J, R = plain.jacobian(q), plain.tool(q)[1]
    return np.vstack([R @ J[:3], R @ J[3:]])


@pytest.mark.parametrize("in_tool", [False, True])
def test_jacobian_and_inertia_are_those_of_energies_and_differences(
    arm: Arm, plain: PlainArm, in_tool: bool
) -> None:
    space, q_ref = ToolSpace(arm), arm.home + 0.2
    space.set_reference(q_ref)
    arm.place(arm.home)
    space.update(in_tool=in_tool)
    J = world_jacobian(plain, arm.home)
    if in_tool:
        R = plain.tool(q_ref)[1].T
        J = np.vstack([R @ J[:3], R @ J[3:]])
    assert np.abs(space.J - J).max() < 1e-5
    inverse = J @ np.linalg.solve(plain.mass_matrix(arm.home), J.T)
    if np.linalg.cond(inverse) < 1e4:
        assert space.inertia @ inverse == pytest.approx(np.eye(6), abs=2e-3)
    assert space.position_ref == pytest.approx(plain.tool(q_ref)[0])
    assert space.inertias == pytest.approx(np.diag(space.inertia))


def test_null_space_motions_do_not_move_the_tool(
    arm: Arm, plain: PlainArm, rng: np.random.Generator
) -> None:
    space, motions = ToolSpace(arm), rng.uniform(-1, 1, (2, arm.n))
    space.motions[:] = motions
    space.set_reference(arm.home)
    arm.place(arm.home)
    space.update(in_tool=False)
    for v, felt, unfelt in zip(motions, space.twists, space.null_space_motions(), strict=True):
        assert felt == pytest.approx(world_jacobian(plain, arm.home) @ v, abs=1e-5)
        assert np.abs(world_jacobian(plain, arm.home) @ unfelt).max() < 1e-5
        # The rest is orthogonal to it in the metric of the mass matrix.
        assert abs(unfelt @ plain.mass_matrix(arm.home) @ (v - unfelt)) < 1e-4


@pytest.mark.parametrize("in_tool", [False, True])
def test_the_jacobians_rate_is_its_difference_along_the_motion(
    arm: Arm, plain: PlainArm, rng: np.random.Generator, in_tool: bool
) -> None:
    space, (v, w) = ToolSpace(arm), rng.uniform(-1, 1, (2, arm.n))
    space.set_reference(arm.home + 0.1)
    arm.place(arm.home)
    space.update(in_tool=in_tool)
    arm.inverse_dynamics_here(v, v)
    h = 1e-3
    ahead, behind = (world_jacobian(plain, arm.home + s * h * v) for s in (1, -1))
    rate = ((ahead - behind) @ w / (2 * h)).reshape(2, 3)
    if in_tool:
        rate = rate @ plain.tool(arm.home + 0.1)[1]
    found = space.jacobian_rate_times(w, in_tool=in_tool)
    assert found == pytest.approx(rate.reshape(6), abs=1e-3)


def test_the_two_halves_are_the_inverse_dynamics(arm: Arm, rng: np.random.Generator) -> None:
    q, (v, a) = arm.home + 0.1, rng.uniform(-1, 1, (2, arm.n))
    whole = arm.inverse_dynamics(q, v, a)
    arm.inverse_dynamics(arm.home, a, v)
    arm.place(q)
    assert arm.inverse_dynamics_here(v, a) == pytest.approx(whole, abs=1e-12)


def test_towards_a_singularity_the_inertia_grows_smoothly_to_a_bound(arm: Arm) -> None:
    straight = np.clip(np.zeros(arm.n), arm.q_min + 0.02, arm.q_max - 0.02)
    space, before = ToolSpace(arm), None
    scale = np.array([1.0] * 3 + [1 / 0.3**2] * 3)
    for t in np.linspace(1.0, 0.0, 400) ** 3:
        q = straight + t * (arm.home - straight)
        space.set_reference(q)
        arm.place(q)
        space.update(in_tool=False)
        inertias = scale * space.inertias
        assert np.isfinite(inertias).all()
        assert inertias.max() <= 1.4 * MASS_MAX
        use = space.inertia @ np.diag(scale)
        if before is not None:
            assert np.abs(use - before).max() < 0.35 * MASS_MAX
        before = use


@pytest.mark.parametrize("in_tool", [False, True])
def test_the_turn_is_the_shorter_one_from_the_tool_to_its_reference(
    arm: Arm, plain: PlainArm, rng: np.random.Generator, in_tool: bool
) -> None:
    space = ToolSpace(arm)
    for _ in range(20):
        q, q_ref = (plain.at(rng.uniform(0, 1, arm.n)) for _ in range(2))
        space.set_reference(q_ref)
        arm.place(q)
        R, R_ref = plain.tool(q)[1], plain.tool(q_ref)[1]
        w, *xyz = space.orientation_error(in_tool=in_tool)
        assert w >= 0.0
        asked = R.T @ R_ref if in_tool else R_ref @ R.T
        assert np.abs(Rotation.from_quat([*xyz, w]).as_matrix() - asked).max() < 1e-9


def test_a_reference_that_rests_moves_again(arm: Arm, plain: PlainArm) -> None:
    space = ToolSpace(arm)
    for turn in (0.0, 0.0, 0.1, 0.1, -0.1):
        space.set_reference(arm.home + turn)
        assert space.position_ref == pytest.approx(plain.tool(arm.home + turn)[0])
