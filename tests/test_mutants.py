"""The list of mutants fits the sources; trying them takes minutes: `python -m tests.mutants`."""

import ast

from tests.mutants import ROOT, read_mutants


def test_every_mutant_is_a_mistake_in_one_place_and_names_who_catches_it() -> None:
    mutants = read_mutants()
    assert len(mutants) >= 60
    for mutant in mutants:
        text = (ROOT / mutant.file).read_text("utf-8")
        assert ast.dump(ast.parse(mutant.mutated(text))) != ast.dump(ast.parse(text))
        assert all((ROOT / "tests" / name).exists() for name in mutant.tests)
