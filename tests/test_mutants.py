"""The list of mutants fits the sources; trying them takes minutes: `python -m tests.mutants`."""

import ast
from pathlib import Path
from threading import Barrier, Lock

from tests.mutants import ROOT, _shared, read_mutants


def test_every_mutant_is_a_mistake_in_one_place_and_names_who_catches_it() -> None:
    mutants = read_mutants()
    assert len(mutants) >= 60
    for mutant in mutants:
        text = (ROOT / mutant.file).read_text("utf-8")
        mutated = mutant.mutated(text)
        if mutant.file.endswith(".py"):
            assert ast.dump(ast.parse(mutated)) != ast.dump(ast.parse(text))
        assert mutated != text
        assert all((ROOT / "tests" / name).exists() for name in mutant.tests)


def test_copies_share_the_work_and_none_has_two_mistakes_at_once() -> None:
    copies, busy, together = [Path("a"), Path("b")], dict.fromkeys("ab", False), Barrier(2)
    lock = Lock()

    def work(copy: Path, item: int) -> str | None:
        with lock:
            assert not busy[copy.name]
            busy[copy.name] = True
        # Both work, or neither goes on.
        together.wait(timeout=30.0)
        with lock:
            busy[copy.name] = False
        return None if item == 3 else f"test {item}"

    caught = list(_shared(copies, work, range(8)))
    assert caught == [None if item == 3 else f"test {item}" for item in range(8)]
