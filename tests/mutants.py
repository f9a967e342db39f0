"""Mutants: are mistakes that were made on purpose caught? `python -m tests.mutants`.

Each of tests/mutants.toml changes one place of the sources in a copy of the repository, where the
tests that are to catch it then run; several copies share the work. A mutant that survives is one
that they let pass.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from typing import TypeVar

from rich.console import Console

from robo47_qp.arrays import Count
from robo47_qp.cli import FAILED, LOGS, OK, main
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.workers.executor import cores
from robo47_qp.files import check_writable, write_json
from robo47_qp.report.provenance import provenance
from robo47_qp.report.terminal import print_files

ROOT = Path(__file__).resolve().parents[1]
MUTANTS = ROOT / "tests" / "mutants.toml"
_PASSED, _CAUGHT, _BROKEN = 0, 1, 2
"""Exit codes of pytest: all passed, some failed, a file could not be read."""
Item = TypeVar("Item")


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """A mistake in one place."""

    file: str
    """File, from the root of the repository."""
    old: str
    """What stands there; nowhere else in the file."""
    new: str
    """What is put in its place."""
    tests: list[str]
    """Files and folders in tests/ that are to catch it."""

    def mutated(self, text: str) -> str:
        """Return the text of its file with the mistake.

        Raises:
            InvalidValueError: The place is not there, or is not the only one.
        """
        found = text.count(self.old)
        if found != 1:
            raise InvalidValueError(f"places of {self.old!r} in {self.file}", found, "one")
        return text.replace(self.old, self.new)


@dataclass(frozen=True, kw_only=True)
class MutantOptions:
    """Options."""

    only: str = ""
    """Part of the names of the files to change; all by default."""
    workers: Count = field(default_factory=cores)
    """Number of mutants that are tried at once; by default one per core."""
    report: Path = LOGS / "mutants.json"
    """File for what was caught (JSON)."""


def read_mutants() -> list[Mutant]:
    """Return all mutants."""
    return [Mutant(**one) for one in tomllib.loads(MUTANTS.read_text("utf-8"))["mutant"]]


def run(options: MutantOptions, console: Console) -> int:
    """Try the mutants, tell and write what was caught; return 0 if all were."""
    check_writable(options.report)
    made = provenance()
    chosen = [mutant for mutant in read_mutants() if options.only in mutant.file]
    if not chosen:
        raise InvalidValueError(
            "--only", options.only, "a part of the name of a file in mutants.toml"
        )
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        workers = min(options.workers, len(chosen))
        copies = [_copied(Path(folder) / f"copy {i}") for i in range(workers)]
        tests = sorted({name for mutant in chosen for name in mutant.tests})
        for broken in _shared(copies, lambda copy, name: _failing(copy, [name]), tests):
            if broken is not None:
                raise InvalidValueError("tests without a mistake", f"{broken} fails", "all to pass")
        for mutant, caught in zip(chosen, _shared(copies, _tried, chosen), strict=True):
            told = f"caught by {caught}" if caught else "SURVIVED"
            console.print(f"{mutant.file}: {mutant.new!r} {told}", soft_wrap=True, markup=False)
            rows.append({"file": mutant.file, "old": mutant.old, "new": mutant.new, "by": caught})
    count = sum(row["by"] is not None for row in rows)
    console.print(f"{count} of {len(rows)} caught")
    write_json(options.report, {**made, "mutants": len(rows), "caught": count, "rows": rows})
    print_files(console, {"report": options.report})
    return OK if count == len(rows) else FAILED


def _shared(
    copies: Sequence[Path], work: Callable[[Path, Item], str | None], items: Sequence[Item]
) -> Iterator[str | None]:
    """Yield what comes of each item, in order; in each copy, one is worked on at a time."""
    free: SimpleQueue[Path] = SimpleQueue()
    for copy in copies:
        free.put(copy)

    def one(item: Item) -> str | None:
        copy = free.get()
        try:
            return work(copy, item)
        finally:
            free.put(copy)

    with ThreadPoolExecutor(len(copies)) as pool:
        yield from pool.map(one, items)


def _copied(folder: Path) -> Path:
    """Copy the files that git knows, and the compiled core where there is one."""
    listed = subprocess.run(
        ["git", "-C", str(ROOT), "ls-files", "-z"], capture_output=True, check=True, text=True
    )
    for name in filter(None, listed.stdout.split("\0")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)
    core = Path("robo47_qp", "_core", "built")
    if (ROOT / core).is_dir():
        shutil.copytree(ROOT / core, folder / core, dirs_exist_ok=True)
    return folder


def _tried(copy: Path, mutant: Mutant) -> str | None:
    """Return the test that fails with a mutant; None if none does."""
    file = copy / mutant.file
    original = file.read_text("utf-8")
    file.write_text(mutant.mutated(original), encoding="utf-8")
    try:
        return _failing(copy, mutant.tests)
    finally:
        file.write_text(original, encoding="utf-8")


def _failing(copy: Path, tests: Sequence[str]) -> str | None:
    """Return the first test that fails; None if none does."""
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--no-header"]
        + [f"tests/{name}" for name in tests],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    if ended.returncode == _PASSED:
        return None
    lines = ended.stdout.splitlines()
    failed = [line.split()[1] for line in lines if line.startswith(("FAILED", "ERROR"))]
    if ended.returncode not in (_CAUGHT, _BROKEN) or not failed:
        raise RuntimeError(f"pytest ended with {ended.returncode}: {ended.stdout}")
    return failed[0]


if __name__ == "__main__":
    sys.exit(main(MutantOptions, run, __doc__))
