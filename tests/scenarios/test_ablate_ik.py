import json
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from robo47_qp.ik.damping import Damping
from robo47_qp.ik.dls import DlsIk
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.ik.solver import EarlyStopping
from scenarios import ablate_ik
from scenarios.ablate_ik import AblateOptions, Tried, restarted, run, solvers


def test_each_law_is_tried_free_clipped_and_bounded_with_one_setting() -> None:
    law = Damping(per_error=0.1)
    cast = solvers({"by error": DlsIk(damping=law, longest=0.2, widest=0.8)})
    free, clipped, box = (cast[f"by error, {name}"] for name in ("free", "clipped", "box"))
    assert isinstance(free, DlsIk)
    assert isinstance(clipped, DlsIk)
    assert isinstance(box, LmIk)
    assert (free.clip, free.wrap, clipped.clip) == (False, True, True)
    assert free.damping == clipped.damping == box.damping == law
    assert {one.longest for one in (free, clipped, box)} == {0.2}
    assert {one.max_iterations for one in (free, clipped, box)} == {200}
    # All get the same starts and second looks.
    for solver in (clipped, box, cast["qp"], cast["mink"]):
        again = restarted(solver)
        assert isinstance(again, MultiStart)
        assert isinstance(again.solver, EarlyStopping)
        assert again.max_restarts == 200
        assert again.solver.max_iterations == 30  # type: ignore[attr-defined]
        assert again.solver.thorough().max_iterations == 100  # type: ignore[attr-defined]


def test_a_small_ablation_is_printed_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    laws = {"constant": [Damping(constant=0.05), Damping(constant=50.0)]}
    monkeypatch.setattr(ablate_ik, "LAWS", laws)
    monkeypatch.setattr(ablate_ik, "CENTRING", (0.0,))
    screen, out = StringIO(), tmp_path / "ablate.json"
    options = AblateOptions(n=4, tune=3, targets=("uniform",), report=out)
    assert run(options, Console(file=screen, width=80)) == 0
    assert all(len(line) <= 80 for line in screen.getvalue().splitlines() if "ablate" not in line)
    told = json.loads(out.read_text())
    best = told["solvers"]["constant, clipped"]["damping"]["constant"]
    assert best == 0.05  # the other hardly moves
    again = told["solvers"]["constant, clipped*"]
    assert (again["class"], again["solver"]["damping"]["constant"]) == ("MultiStart", 0.05)
    for sweep, tried in (("sweep", 6), ("sweep_restarted", 3)):
        assert len(told[sweep]) == tried
        first, *_ = sorted(told[sweep], key=lambda one: (-one["reached"], one["steps"]))
        assert first["damping"]["constant"] == 0.05
    effects = {(one["effect"], one["to"]): one for one in told["effects"]}
    rates = {row["solver"]: row["success"] for row in told["rows"]}
    for (_, name), one in effects.items():
        low, high = one["interval"]
        assert low <= one["points"] <= high
        assert one["points"] == pytest.approx(100.0 * (rates[name] - rates[one["from"]]))
    assert told["library_seconds"] > 0.0
    for effect in (("bounds", "constant, box"), ("QP", "qp"), ("QP", "qp*")):
        assert effect in effects


def test_of_settings_that_reach_as_many_the_one_with_fewer_steps_is_the_better() -> None:
    slow, quick, more = (
        Tried("constant", DlsIk(), reached=reached, of=9, steps=steps)
        for reached, steps in ((7, 90), (7, 80), (8, 99))
    )
    assert sorted((slow, more, quick), key=lambda one: one.rank) == [slow, quick, more]
