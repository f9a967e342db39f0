"""Under which name a report may be kept is told by what it is of."""

import copy
import json
from typing import Any

import pytest

from scenarios.papers.names import OWN_NAMES
from tests.test_architecture import ROOT

KEPT = ROOT / "docs" / "results"


def report(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((KEPT / f"{name}.json").read_text("utf-8"))
    return found


@pytest.mark.parametrize("name", ["success_none_pick_place", "robots_panda_pick_place"])
def test_one_of_another_robot_is_not_the_default_s(name: str) -> None:
    mine = report("success_none_pick_place")
    other = copy.deepcopy(mine)
    other["settings"]["robot"] = "iiwa14"
    kind = name.partition("_")[0]
    assert OWN_NAMES[kind](mine) == name
    assert OWN_NAMES["success"](other) == OWN_NAMES["alone"](other) == "none of those"
    assert OWN_NAMES["robots"](other) == "robots_iiwa14_pick_place"


def test_when_pushes_come_counts_where_there_are_any() -> None:
    mine = report("success_none_pick_place")
    for time in (None, 10.0):
        mine["settings"]["perturbation"]["push_time"] = time
        assert OWN_NAMES["success"](mine) == "success_none_pick_place"
    severe = report("success_severe_pick_place")
    for time, name in ((None, "success_severe_pick_place"), (10.0, "none of those")):
        severe["settings"]["perturbation"]["push_time"] = time
        assert OWN_NAMES["success"](severe) == name


def test_a_report_of_something_else_has_none_of_these_names() -> None:
    for name in ("step_cost", "compare_ik", "mutants"):
        assert {one(report(name)) for one in OWN_NAMES.values()} == {"none of those"}
