"""The worked example of docs/add_a_task.md: short, found like every task, and it does its job."""

import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from robo47_qp.errors import InvalidValueError
from robo47_qp.run.failure import Cause
from robo47_qp.run.task import Task
from tests.runs import carry_out

PAGE = Path(__file__).parents[2] / "docs" / "add_a_task.md"


@pytest.fixture
def lift(monkeypatch: pytest.MonkeyPatch) -> type[Task]:
    (source,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(source.splitlines()) < 60
    module = ModuleType("lift")
    monkeypatch.setitem(sys.modules, "lift", module)  # where dataclasses look their module up
    exec(compile(source, str(PAGE), "exec"), vars(module))
    found: type[Task] = module.Lift
    return found


@pytest.mark.parametrize("seed", [None, 0])
def test_the_example_lifts_its_cube(lift: type[Task], seed: int | None) -> None:
    run = carry_out(lift(), seed=seed)
    assert run.failure is None
    assert run.rows["objects/cube"][-1, 2] > 0.155


def test_the_example_fails_where_it_should(lift: type[Task]) -> None:
    run = carry_out(lift(height=0.9))  # type: ignore[call-arg]
    assert run.failure is not None
    assert run.failure.cause is Cause.IK
    with pytest.raises(InvalidValueError, match="height must be above 0 and finite; found 0"):
        lift(height=0.0)  # type: ignore[call-arg]
