"""Laws of damping, clamped errors, the null space term and wrapped angles of DLS and LM."""

from dataclasses import replace

import numpy as np
import pytest
from mink import SE3

from robo47_qp.errors import InvalidValueError
from robo47_qp.ik.damping import Damping, clamped
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import Tolerance
from robo47_qp.ik.tool_demand import FULL, POSITION, FreeAxis, ToolDemand
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from tests.examples import shifted, turned

ARM = Arm(PANDA)


class Impatient(DlsIk):
    """A search whose second looks are no longer than the first."""

    def thorough(self) -> "Impatient":
        return Impatient(max_iterations=0)


def far_target() -> object:
    return turned(shifted(ARM.pose(ARM.home), np.array([0.2, 0.3, -0.2])), 0, 1.0)


def test_each_law_is_what_it_says() -> None:
    J = np.diag([0.5, 0.4, 0.1])
    w = 0.02
    assert Damping(constant=0.05).squared(J, 9.0) == pytest.approx(0.0025)
    assert Damping(per_error=0.03).squared(J, 0.5) == pytest.approx(0.015)
    assert Damping(singular=0.2, threshold=0.05).squared(J, 1.0) == pytest.approx(
        (0.2 * (1.0 - w / 0.05)) ** 2
    )
    assert Damping(singular=0.2, threshold=0.01).squared(J, 1.0) == 0.0
    both = Damping(constant=0.1, per_error=0.1, singular=0.1, threshold=0.05)
    assert both.squared(0.0 * J, 1.0) == pytest.approx(0.01 + 0.1 + 0.01)


def test_errors_are_clamped_part_by_part() -> None:
    e = np.array([3.0, 0.0, 4.0, 0.0, 2.0, 0.0])
    assert clamped(e, 1.0, 10.0).tolist() == pytest.approx([0.6, 0.0, 0.8, 0.0, 2.0, 0.0])
    assert clamped(e, 10.0, 0.5).tolist() == pytest.approx([3.0, 0.0, 4.0, 0.0, 0.5, 0.0])
    assert e[0] == 3.0


@pytest.mark.parametrize(
    "law", [Damping(constant=0.1), Damping(per_error=0.3), Damping(singular=0.5, threshold=1.0)]
)
@pytest.mark.parametrize("longest", [np.inf, 0.05])
def test_a_step_of_dls_without_limits_is_that_of_lm(law: Damping, longest: float) -> None:
    target, settings = far_target(), {"damping": law, "longest": longest, "widest": 10 * longest}
    dls = DlsIk(clip=False, max_iterations=1, **settings)  # type: ignore[arg-type]
    lm = LmIk(within_limits=False, max_iterations=1, **settings)  # type: ignore[arg-type]
    a, b = (one.solve(ARM, target, ARM.home).q for one in (dls, lm))  # type: ignore[arg-type]
    assert np.abs(a - ARM.home).max() > 0.02
    # LM adds 1e-9 to every damping.
    np.testing.assert_allclose(a, b, atol=1e-5)


def test_a_law_of_the_error_is_the_default_of_lm() -> None:
    target = far_target()
    a = LmIk(max_iterations=7).solve(ARM, target, ARM.home).q  # type: ignore[arg-type]
    law = Damping(per_error=0.03)
    b = LmIk(max_iterations=7, damping=law).solve(ARM, target, ARM.home).q  # type: ignore[arg-type]
    assert a.tobytes() == b.tobytes()


def test_clamping_shortens_only_what_is_far() -> None:
    target = far_target()
    steps = [
        np.linalg.norm(
            DlsIk(max_iterations=1, longest=longest, widest=10.0 * longest)
            .solve(ARM, target, ARM.home)  # type: ignore[arg-type]
            .q
            - ARM.home
        )
        for longest in (np.inf, 1.0, 0.1, 0.01)
    ]
    assert steps[0] == steps[1] > 1.5 * steps[2] > 3.0 * steps[3] > 0.0


def test_the_null_space_term_centres_joints_and_leaves_the_tool() -> None:
    q = ARM.home + np.array([0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 0.0])
    target = ARM.pose(q)
    away = shifted(target, np.array([1e-3, 0.0, 0.0]))
    middle = 0.5 * (ARM.q_min + ARM.q_max)
    ends = [
        DlsIk(centring=centring, max_iterations=300).solve(ARM, away, q) for centring in (0.0, 0.02)
    ]
    assert all(end.converged for end in ends)
    one = DlsIk(centring=0.02, max_iterations=1).solve(ARM, away, q).q
    plain = DlsIk(max_iterations=1).solve(ARM, away, q).q
    assert np.linalg.norm(one - middle) < np.linalg.norm(plain - middle)
    assert np.abs(ARM.jacobian(q) @ (one - plain)).max() < 1e-9


def test_angles_are_wrapped_into_their_ranges_where_that_is_possible() -> None:
    q = ARM.home.copy()
    q[0] += 2.0 * np.pi
    near = q + 0.01
    target = ARM.pose(ARM.home)
    plain = DlsIk(clip=False).solve(ARM, target, near)
    wrapped = DlsIk(clip=False, wrap=True).solve(ARM, target, near)
    assert not plain.converged
    assert wrapped.converged
    assert np.abs(np.sin(0.5 * (plain.q - wrapped.q))).max() < 1e-9


def test_second_looks_count_as_restarts() -> None:
    ik = MultiStart(solver=LmIk(max_iterations=3), max_restarts=12)
    calls = []

    class Counted(LmIk):
        def _attempt(self, *arguments: object) -> object:  # type: ignore[override]
            calls.append(1)
            return super()._attempt(*arguments)  # type: ignore[arg-type]

    rng = np.random.default_rng(3)
    counted, more = 0, MultiStart(solver=Counted(max_iterations=3), max_restarts=12)
    for _ in range(20):
        target = ARM.pose(rng.uniform(ARM.q_min, ARM.q_max))
        calls.clear()
        result = more.solve(ARM, target, ARM.home)
        assert result.restarts == len(calls) - 1 or not result.converged
        counted += result.restarts > 12 or (result.restarts > 9 and result.converged)
        assert result.restarts == ik.solve(ARM, target, ARM.home).restarts
    assert counted > 0


@pytest.mark.parametrize(
    "settings", [{"damping": -1.0}, {"longest": 0.0}, {"widest": float("nan")}, {"centring": -0.1}]
)
def test_what_makes_no_sense_is_refused(settings: dict[str, float]) -> None:
    with pytest.raises(InvalidValueError):
        DlsIk(**settings)  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError):
        Damping(constant=-0.1)


def test_a_demand_on_a_part_of_the_pose_is_no_singularity() -> None:
    """By the volume of the image of a ball, in the directions that are asked for."""
    law = Damping(singular=0.1, threshold=0.01)
    for demand, asked in ((FreeAxis(), 5), (POSITION, 3), (FULL, 6)):
        J = demand.jacobian(ARM, ARM.pose(ARM.home), ARM.home)
        values = np.sort(np.sqrt(np.clip(np.linalg.eigvalsh(J @ J.T), 0.0, None)))[::-1]
        w = float(np.prod(values[:asked]))
        assert w > law.threshold
        assert law.squared(J, 0.0, asked) == 0.0
        near = Damping(singular=0.1, threshold=2.0 * w)
        assert near.squared(J, 0.0, asked) == pytest.approx(0.0025, rel=1e-6)
    target = SE3.from_translation(np.array([0.0, 0.0, 0.01])) @ ARM.pose(ARM.home)
    plain = DlsIk(damping=1e-6, tolerance=Tolerance(demand=POSITION), max_iterations=1)
    lawful = replace(plain, damping=Damping(constant=1e-6, singular=0.1, threshold=1e-3))
    first, second = (solver.solve(ARM, target, ARM.home).q for solver in (plain, lawful))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("demand", [POSITION, FreeAxis()])
def test_no_damping_is_the_least_step(demand: ToolDemand) -> None:
    target = SE3.from_translation(np.array([0.0, 0.02, 0.01])) @ ARM.pose(ARM.home)
    undamped = DlsIk(damping=0.0, tolerance=Tolerance(demand=demand))
    exact, nearly = (
        replace(undamped, damping=damping, max_iterations=1).solve(ARM, target, ARM.home).q
        for damping in (0.0, 1e-6)
    )
    np.testing.assert_allclose(exact, nearly, atol=1e-8)
    assert MultiStart(solver=undamped).solve(ARM, target, ARM.home).converged


def test_dls_continues_its_closest_ends_as_the_qp_does() -> None:
    few = DlsIk(max_iterations=30)
    assert few.thorough().max_iterations == 100
    assert DlsIk().thorough() == DlsIk()
    rng, found = np.random.default_rng(5), {}
    targets = [ARM.pose(rng.uniform(ARM.q_min, ARM.q_max)) for _ in range(30)]
    for name, each in (("with", few), ("without", Impatient(max_iterations=30))):
        search = MultiStart(solver=each, max_restarts=10)
        found[name] = sum(search.solve(ARM, one, ARM.home).converged for one in targets)
    assert found["with"] > found["without"]
