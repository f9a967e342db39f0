"""Policies as they are named: which stack or class each is, labels, what makes no sense."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from robo47_qp.cli import main
from robo47_qp.control.friction import FrictionLearning
from robo47_qp.control.observer import DisturbanceObserver
from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.evaluation.options import EvaluateOptions
from robo47_qp.evaluation.policies import (
    IK_NAMES,
    NAMES,
    Contender,
    PolicyReference,
    labels,
    policy_settings,
)
from robo47_qp.ik.damping import Damping
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.gauss_newton import Stall
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.mink import MinkIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.qp import QpIk
from robo47_qp.ik.solver import IkSolver
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.run.policy.drivers import PolicyTiming
from robo47_qp.stack import ClassicalStack
from tests.runs import Reach

THREE = ("classical:qp", "classical:dls", "classical:dls-single")


@pytest.mark.parametrize(
    ("setting", "error", "message"),
    [
        (
            {"policy": ("classical:foo",)},
            UnknownNameError,
            r"No policy is called 'classical:foo'; known: classical, classical:mink, classical:qp, "
            r"classical:lm, classical:dls, classical:mink-single, classical:qp-single, "
            r"classical:lm-single, classical:dls-single, module:Class, file\.py:Class",
        ),
        ({"policy": ("classical:",)}, UnknownNameError, "No policy is called 'classical:'"),
        (
            {"policy": ("classical:dls", "classical:qp", "classical:dls")},
            InvalidValueError,
            "--policy must be another one each time; found classical:dls and classical:dls, which",
        ),
        (
            {"policy": ("classical", "classical:lm"), "ik": "lm"},
            InvalidValueError,
            "found classical and classical:lm, which are one and the same",
        ),
        (
            {"policy": ("a.py:B", "./a.py:B")},
            InvalidValueError,
            r"found a\.py:B and \./a\.py:B, which are one and the same",
        ),
        (
            {"policy": THREE, "against": Path("other.json")},
            InvalidValueError,
            "--against must be left out with several policies; found other.json",
        ),
        (
            {"policy": THREE, "replay": 0},
            InvalidValueError,
            "--replay must be left out with several policies; found 0",
        ),
        (
            {"policy": THREE, "ik": "lm"},
            InvalidValueError,
            "--ik must be left out without --policy classical; found lm",
        ),
        (
            {"policy": THREE, "rate": 10.0},
            InvalidValueError,
            "--rate must be left out with --policy classical",
        ),
        (
            {"policy": ("a.py:B", "classical:dls"), "qp_solver": "osqp"},
            InvalidValueError,
            "--qp-solver must be left out without a --policy classical whose IK is mink or qp",
        ),
    ],
)
def test_policies_that_make_no_sense_are_refused(
    setting: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        EvaluateOptions(**setting)


def test_a_qp_solver_goes_to_the_policies_that_solve_a_qp() -> None:
    options = EvaluateOptions(policy=("classical:qp", "classical:dls"), qp_solver="osqp")
    first, second = (one.evaluation(Reach(), PANDA).policy for one in options.each)
    assert isinstance(first, ClassicalStack)
    assert isinstance(second, ClassicalStack)
    assert (first.qp_solver, second.qp_solver) == ("osqp", ClassicalStack.qp_solver)


@pytest.mark.parametrize("clearance", [None, 0.01])
def test_each_ik_is_the_solver_that_is_promised(clearance: float | None) -> None:
    hasty = {"stall": Stall(), "clearance": clearance}
    damping = Damping(per_error=0.1)
    dls = DlsIk(damping=damping, longest=0.1, widest=0.4, clip=True, clearance=clearance)
    promised: dict[str, IkSolver] = {
        "mink": MultiStart(solver=MinkIk(max_iterations=30, **hasty)),  # type: ignore[arg-type]
        "qp": MultiStart(solver=QpIk(max_iterations=30, **hasty)),  # type: ignore[arg-type]
        "lm": MultiStart(solver=LmIk(max_iterations=20, **hasty)),  # type: ignore[arg-type]
        "dls": MultiStart(solver=dls),
        "mink-single": MinkIk(max_iterations=100, clearance=clearance),
        "qp-single": QpIk(max_iterations=100, clearance=clearance),
        "lm-single": LmIk(max_iterations=100, clearance=clearance),
        "dls-single": dls,
    }
    assert set(promised) == set(IK_NAMES)
    for name in IK_NAMES:
        assert ClassicalStack(ik=name).solver(clearance) == promised[name]
        assert isinstance(promised[name], MultiStart) != name.endswith("-single")
    osqp = ClassicalStack(ik="qp-single", qp_solver="osqp").solver(clearance)
    assert osqp == QpIk(backend="osqp", clearance=clearance)


def test_each_name_means_one_stack() -> None:
    assert EvaluateOptions().contenders == [Contender(name="classical", ik="mink")]

    def stack_of(chosen: EvaluateOptions) -> ClassicalStack:
        policy = chosen.evaluation(Reach(), PANDA).policy
        assert isinstance(policy, ClassicalStack)
        return policy

    assert stack_of(EvaluateOptions(ik="dls")).ik == "dls"
    for name in NAMES[1:]:
        (alone,) = EvaluateOptions(policy=(name,)).each
        assert stack_of(alone).ik == name.partition(":")[2]
        assert alone.files["report"].name == "eval.json"
    mixed = EvaluateOptions(policy=("classical", "a.py:B", "classical:dls"), ik="lm", rate=9.0)
    assert [one.contender.ik for one in mixed.each] == ["lm", None, "dls"]
    assert [one.rate for one in mixed.each] == [30.0, 9.0, 30.0]
    assert [one.files["journal"].name for one in mixed.each] == [
        "eval.classical.jsonl",
        "eval.a-py-B.jsonl",
        "eval.classical-dls.jsonl",
    ]


def test_labels_are_safe_in_file_names_and_differ() -> None:
    names = ["a/b.py:C", "a-b.py:C", "A/b.py:c", "../x y|z:D", f"{'long/' * 99}e.py:F", "m.n:Üb"]
    found = labels([Contender(name=name, ik=None) for name in names])
    assert len({label.lower() for label in found}) == len(names)
    for label in found:
        assert label.replace("-", "").replace("_", "").isalnum()
        assert label.isascii()
        assert len(label) < 80
    assert found[3] == "x-y-z-D"
    assert found[4].endswith("e-py-F")
    cased = labels([Contender(name=name, ik=None) for name in ("a.py:C", "A.py:c")])
    assert len({label.lower() for label in cased}) == 2
    # The same files whatever comes first: what was begun can be gone on with.
    turned = labels([Contender(name=name, ik=None) for name in reversed(names)])
    assert turned[::-1] == found


def test_policies_are_named_one_by_one_on_the_command_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[EvaluateOptions] = []

    def run(chosen: EvaluateOptions, console: Console) -> int:
        seen.append(chosen)
        return 0

    for arguments in ([], ["--policy", "a:B"], ["--policy", "classical:dls", "--policy", "a:B"]):
        monkeypatch.setattr(sys, "argv", ["evaluate.py", *arguments])
        assert main(EvaluateOptions, run, "", repeated=True) == 0
    assert [chosen.policy for chosen in seen] == [(), ("a:B",), ("classical:dls", "a:B")]
    monkeypatch.setattr(sys, "argv", ["evaluate.py", "--policy", "classical:dls", "classical:qp"])
    with pytest.raises(SystemExit) as end:
        main(EvaluateOptions, run, "", repeated=True)
    assert end.value.code == 2
    assert "classical:qp" in capsys.readouterr().err


def test_settings_of_an_observer_are_told_and_the_usual_ones_as_they_were() -> None:
    def observer(chosen: DisturbanceObserver | None) -> Any:
        own = policy_settings(ClassicalStack(observer=chosen), None)
        stack = ClassicalStack(observer=chosen)
        theirs = PolicyReference(text="tests.toy_policies:LazyPolicy", stack=stack)
        assert policy_settings(theirs, None)["observer"] == own["observer"]
        return json.loads(json.dumps(own["observer"]))

    assert observer(DisturbanceObserver()) is True
    assert observer(None) is False
    slow = observer(DisturbanceObserver(bandwidth=70.0))
    assert (slow["class"], slow["bandwidth"]) == ("DisturbanceObserver", 70.0)
    learning = FrictionLearning(most=0.2)
    assert observer(DisturbanceObserver(friction=learning))["friction"]["most"] == 0.2
    assert observer(DisturbanceObserver(friction=None))["friction"] is None


def test_the_length_of_a_policys_episodes_is_told_where_it_is_its_own() -> None:
    def seconds(chosen: float | None) -> Any:
        timing = PolicyTiming(seconds=chosen)
        policy = PolicyReference(text="tests.toy_policies:LazyPolicy", timing=timing)
        return policy_settings(policy, None).get("seconds")

    assert seconds(None) is None
    assert seconds(2.5) == 2.5
