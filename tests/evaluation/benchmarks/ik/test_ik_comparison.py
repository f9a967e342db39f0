"""The comparison: paired, fair, judged from outside, and the same again to the bit."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.benchmarks.ik.answers import RAISED, Answers, Outcome, outcomes
from robo47_qp.evaluation.benchmarks.ik.catalogue import solvers
from robo47_qp.evaluation.benchmarks.ik.comparison import Comparison, Field, Start
from robo47_qp.evaluation.benchmarks.ik.judge import Judge
from robo47_qp.evaluation.benchmarks.ik.summary import paired_tests, reason_rows, rows, summary
from robo47_qp.evaluation.benchmarks.ik.targets import MakeTargets, TargetSet, tabletop, uniform
from robo47_qp.evaluation.benchmarks.ik.unreachable import hostile, unreachable
from robo47_qp.evaluation.statistics import wilson
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.solver import IkResult, IkSolver, Tolerance, judged
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.model.tool_poses import Target
from robo47_qp.report.provenance import provenance

ARM = Arm(PANDA)
JUDGE = Judge(PANDA)
# Poses of these configurations, and what is wrong with each as an answer.
FINE = np.array(PANDA.home)
COLLIDING = np.array([0.0, 1.7, 0.0, -2.9, 0.0, 0.5, 0.8])
OUTSIDE = np.array([2.9, *PANDA.home[1:]])


@dataclass
class Scripted:
    """Says what it was told to; claims success always; keeps what it was asked."""

    say: Callable[[Any, Vector, int], Vector]
    tolerance: Tolerance = Tolerance(position=1e9, orientation=1e9)
    asked: list[tuple[Target, Vector]] = field(default_factory=list)

    def solve(self, arm: Arm, T_world_target: Target, q_seed: Vector) -> IkResult:
        self.asked.append((T_world_target, q_seed.copy()))
        q = self.say(T_world_target, q_seed, len(self.asked) - 2)
        result = judged(arm, T_world_target, q, self.tolerance, 7)
        return replace(result, reason=None, restarts=2)


def four(_arm: Arm, n: int, _rng: np.random.Generator) -> TargetSet:
    configurations = [FINE, COLLIDING, OUTSIDE, FINE][:n]
    return TargetSet(name="four", targets=[ARM.pose(q) for q in configurations], reachable=True)


def run(
    solvers: dict[str, IkSolver], *makes: MakeTargets, n: int, **settings: Any
) -> tuple[Comparison, list[Sequence[Answers]]]:
    fields = {make.__name__: Field(make=make, judge=JUDGE) for make in makes}
    one_by_one = {"block": 1, "warm": 0}
    comparison = Comparison(arm=ARM, solvers=solvers, fields=fields, n=n, **(one_by_one | settings))
    return comparison, list(comparison.run(lambda _field, _done: None))


def known(_target: SE3, _seed: Vector, k: int) -> Vector:
    """The first three answers get there, each in its way; the last is off by a millimetre."""
    if k < 0:
        return FINE
    return [FINE, COLLIDING, OUTSIDE, FINE + 2e-3][k]


def test_a_row_says_what_the_judge_found_whatever_the_solver_claims() -> None:
    _, (answers,) = run({"scripted": Scripted(known)}, four, n=4)
    (row,) = rows(answers)
    assert (row["solver"], row["targets"], row["n"]) == ("scripted", "four", 4)
    assert row["success"] == 0.5
    assert row["interval"] == list(wilson(2, 4))
    assert row["tight"] == 0.5
    assert row["collision_free"] == 0.25
    assert row["limit_violations"] == 1
    assert row["false_claims"] == 2
    assert row["raised"] == 0
    assert row["reached_by_any"] == 2
    assert row["missed"] == 0
    assert row["median_iterations"] == 7
    assert row["mean_restarts"] == 2
    assert outcomes(answers[0]) == [
        *(Outcome.REACHED, Outcome.COLLIDING, Outcome.OUTSIDE, Outcome.MISSED)
    ]


def test_every_solver_is_asked_the_same_from_the_same_seeds() -> None:
    home = Scripted(lambda _target, seed, _k: seed)
    other = Scripted(lambda _target, seed, _k: seed)
    for start in Start:
        home.asked.clear()
        other.asked.clear()
        run({"a": home, "b": other}, uniform, n=5, start=start)
        assert len(home.asked) == len(other.asked) == 6
        for (one, seed), (two, same) in zip(home.asked, other.asked, strict=True):
            assert one is two or repr(one) == repr(two)
            assert seed.tobytes() == same.tobytes()
        seeds = np.array([seed for _, seed in home.asked[1:]])
        assert (seeds == PANDA.home).all() is np.bool_(start is Start.HOME)
        assert (seeds >= ARM.q_min).all()
        assert (seeds <= ARM.q_max).all()


def test_a_solver_cannot_spoil_the_question_for_the_next() -> None:
    def spoil(_target: SE3, seed: Vector, _k: int) -> Vector:
        seed[:] = 0.0
        return FINE

    honest = Scripted(lambda _target, seed, _k: seed)
    run({"spoiler": Scripted(spoil), "honest": honest}, uniform, n=3)
    for _, seed in honest.asked:
        np.testing.assert_array_equal(seed, PANDA.home)


def test_a_set_does_not_depend_on_what_else_is_compared() -> None:
    solver = LmIk(max_iterations=5)
    _, alone = run({"lm": solver}, tabletop, n=4)
    _, both = run({"other": solver, "lm": solver}, uniform, tabletop, n=4)
    assert alone[0][0].digest() == both[1][1].digest()


def test_the_same_seed_gives_the_same_to_the_bit_and_another_does_not() -> None:
    solver = LmIk(max_iterations=20)
    digests = [run({"lm": solver}, uniform, n=20, seed=s)[1][0][0].digest() for s in (1, 1, 2)]
    assert digests[0] == digests[1] != digests[2]


def test_a_digest_sees_the_last_bit() -> None:
    nudged = Scripted(lambda _target, seed, _k: np.nextafter(seed, 4.0))
    _, (answers,) = run({"a": Scripted(lambda _t, seed, _k: seed), "b": nudged}, four, n=1)
    assert answers[0].digest() != answers[1].digest()


def test_an_exception_is_counted_and_does_not_stop_the_others() -> None:
    def refuse(_target: SE3, _seed: Vector, k: int) -> Vector:
        if k == 1:
            raise ValueError("not this one")
        return FINE

    _, (answers,) = run({"a": Scripted(refuse), "b": Scripted(known)}, four, n=4)
    first, second = rows(answers)
    assert (first["raised"], second["raised"]) == (1, 0)
    assert first["reasons"] == {RAISED: 1}
    assert answers[0].items[1].explanation == "ValueError: not this one"
    assert outcomes(answers[0])[1] is Outcome.RAISED
    assert first["success"] == 0.5


def test_an_interruption_keeps_what_is_paired() -> None:
    def stop(_target: SE3, _seed: Vector, k: int) -> Vector:
        if k == 2:
            raise KeyboardInterrupt
        return FINE

    fields = {"four": Field(make=four, judge=JUDGE)}
    solvers: dict[str, IkSolver] = {"a": Scripted(known), "b": Scripted(stop)}
    comparison = Comparison(arm=ARM, solvers=solvers, fields=fields, n=4, block=1, warm=0)
    iterator = comparison.run(lambda _field, _done: None)
    kept = next(iterator)
    with pytest.raises(KeyboardInterrupt):
        next(iterator)
    assert [answers.n for answers in kept] == [2, 2]


def test_solvers_take_turns_in_blocks_and_warm_up_unseen() -> None:
    turns: list[str] = []

    def says(name: str) -> Scripted:
        def answer(_target: SE3, _seed: Vector, _k: int) -> Vector:
            turns.append(name)
            return FINE

        return Scripted(answer)

    solvers: dict[str, IkSolver] = {"a": says("a"), "b": says("b")}
    _, (answers,) = run(solvers, four, n=4, block=3, warm=2)
    first, rest = [*"aaaaa"], [*"aa"]
    swapped = [["b"] * len(part) for part in (first, rest)]
    assert turns == ["a", "b", *first, *swapped[0], *rest, *swapped[1]]
    assert [row.n for row in answers] == [4, 4]


def test_missed_is_what_another_reached() -> None:
    first = Scripted(lambda _target, _seed, k: FINE if k < 1 else FINE + 0.1)
    second = Scripted(lambda _target, _seed, k: FINE if k in (-1, 3) else FINE + 0.1)
    _, (answers,) = run({"a": first, "b": second}, four, n=4)
    assert [row["reached_by_any"] for row in rows(answers)] == [2, 2]
    assert [row["missed"] for row in rows(answers)] == [1, 1]
    (test,) = paired_tests([answers], {("a", "b")})
    assert (test.a, test.b, test.only_a, test.only_b, test.p) == ("a", "b", 1, 1, 1.0)
    assert test.planned


def test_planned_pairs_are_corrected_among_themselves() -> None:
    solvers: dict[str, IkSolver] = {
        "good": LmIk(max_iterations=40),
        "none": LmIk(max_iterations=0),
        "zero": LmIk(max_iterations=0),
    }
    _, fields = run(solvers, uniform, n=12)
    tests = {(t.a, t.b): t for t in paired_tests(fields, {("good", "none")})}
    assert len(tests) == 3
    assert tests["good", "none"].p_holm == tests["good", "none"].p
    assert tests["good", "zero"].p_holm == pytest.approx(2 * tests["good", "zero"].p)
    assert tests["good", "none"].only_a >= 6


def test_reasons_are_counted_by_class() -> None:
    _, fields = run({"lm": LmIk(max_iterations=15)}, unreachable, hostile, n=10)
    assert paired_tests(fields, ()) == []
    found = {row["kind"]: row for field in fields for row in reason_rows(field[0])}
    assert found["too_far"]["right"] == found["too_far"]["n"] == 2
    assert found["too_far"]["said"] == {"OUT_OF_REACH": 2}
    assert found["nan"]["right"] == 3
    assert sum(row["n"] for row in found.values()) == 20
    claims = Scripted(lambda _target, _seed, _k: FINE)
    _, (answers,) = run({"liar": claims}, unreachable, n=5)
    assert all(row["right"] == 0 for row in reason_rows(answers[0]))
    assert set(outcomes(answers[0])) == {Outcome.WRONG_REASON}


def test_the_report_has_what_a_reader_looks_for_and_survives_json() -> None:
    comparison, fields = run({"lm": LmIk(), "again": LmIk()}, uniform, hostile, n=5)
    found = summary(comparison, fields, (), {"peer": "not installed"}, provenance(), complete=True)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    names = {"solver", "targets", "n", "success", "interval", "tight", "collision_free"}
    names |= {"median_ms", "p95_ms", "p99_ms", "limit_violations", "sha256"}
    assert len(found["rows"]) == 4
    for row in found["rows"]:
        assert names <= set(row)
        assert 0.0 <= row["median_ms"] <= row["p95_ms"] <= row["p99_ms"] <= row["max_ms"]
    assert found["solvers"]["lm"]["class"] == "LmIk"
    assert found["left_out"] == {"peer": "not installed"}
    assert {"mujoco", "daqp", "numpy"} <= set(found["versions"])
    assert (found["seed"], found["n"], found["complete"]) == (0, 5, True)
    assert len(found["paired"]) == 1


@pytest.mark.parametrize(
    ("wrong", "words"),
    [({"n": 0}, "--n must be 1"), ({"seed": -1}, "--seed"), ({"solvers": {}}, "--solvers")],
)
def test_nothing_to_compare_is_refused(wrong: dict[str, Any], words: str) -> None:
    right: dict[str, Any] = {"arm": ARM, "solvers": {"lm": LmIk()}, "n": 1}
    right["fields"] = {"four": Field(make=four, judge=JUDGE)}
    with pytest.raises(InvalidValueError, match=words):
        Comparison(**right | wrong)


def test_every_dls_that_knows_no_limits_wraps_its_angles() -> None:
    found = {name: getattr(one, "solver", one) for name, one in solvers().items()}
    free = {name: one for name, one in found.items() if isinstance(one, DlsIk) and not one.clip}
    assert {"dls", "dls-multi", "dls-position", "dls-tuned-free"} <= free.keys()
    assert all(one.wrap for one in free.values())
