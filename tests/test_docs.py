"""The documentation holds: its code runs, its commands parse, what it links to and names exists."""

import ast
import os
import pkgutil
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from textwrap import dedent, indent
from types import ModuleType
from typing import Any, NoReturn

import pytest
import tyro

from robo47_qp import __main__
from robo47_qp.ik.lm import LmIk
from robo47_qp.ik.multistart import MultiStart
from robo47_qp.report.rerun import recovery, viewer
from robo47_qp.run.failure import Cause

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
EXTENDING = ROOT / "docs" / "extending.md"
UPSTREAM = sorted((ROOT / "docs" / "upstream").glob("*.md"))
LINKED = [*PAGES, *UPSTREAM, ROOT / "CHANGELOG.md", ROOT / "logs" / "README.md"]
"""The changelog names what is gone, too: of it, only links are checked."""
PLACEHOLDERS = {
    "NAME": "pick_place",
    "N": "1",
    "SEED": "1",
    "file.py:Class": "tasks/reach/reach.py:Reach",
    "lift.py:Lift": "tasks/reach/reach.py:Reach",
    "six_axis": "panda",
}
"""What stands for a value in a command."""
WRITTEN = re.compile(r"(logs|RETRO\.md)\b")
"""What is there only after a run."""
ELSEWHERE = {"OptIK", "SolvePnP", "McNemar", "JSON", "SE3", "Gymnasium", "OMPL", "DAQP", "OSQP"}
"""Words in capitals that are no names of this repository."""


def page_id(page: Path) -> str:
    return str(page.relative_to(ROOT))


def blocks(page: Path, *languages: str) -> Iterator[tuple[int, str, str]]:
    """Line, mark and text of the fenced blocks in some languages; the mark is "" for most."""
    text = page.read_text(encoding="utf-8")
    for found in re.finditer(r"^```(\S+)[ ]*(\S*)\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        if found[1] in languages:
            yield text[: found.start()].count("\n") + 1, found[2], found[3]


def plain(page: Path) -> str:
    """The Python of a page that is to be run as it is, with its line numbers."""
    text = ""
    for line, mark, block in blocks(page, "python"):
        if not mark:
            text += "\n" * (line - text.count("\n")) + block
    return text


def prose(page: Path) -> str:
    """The text without its fenced blocks."""
    text = page.read_text(encoding="utf-8")
    return re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)


def code_spans(page: Path) -> list[str]:
    return re.findall(r"`([^`\n]+)`", prose(page))


# Code ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", [p for p in PAGES if p != EXTENDING and plain(p)], ids=page_id)
def test_the_python_of_a_page_runs_from_top_to_bottom(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    module = ModuleType("page")
    monkeypatch.setitem(sys.modules, "page", module)  # where dataclasses look their module up
    exec(compile(plain(page), str(page), "exec"), vars(module))


def test_what_the_page_on_extending_adds_works(tmp_path: Path) -> None:
    """Its files and lines are added to a copy of the package; then the rest of the page runs."""
    package = tmp_path / "robo47_qp"
    shutil.copytree(ROOT / "robo47_qp", package, ignore=shutil.ignore_patterns("__pycache__"))
    for _, mark, text in blocks(EXTENDING, "python", "xml"):
        kind, _, where = mark.partition("=")
        file, _, name = where.partition(":")
        path = tmp_path / file
        match kind:
            case "file":
                assert not path.exists()
                path.write_text(text, encoding="utf-8")
            case "import":
                source = path.read_text(encoding="utf-8")
                path.write_text(inserted(source, None, text), encoding="utf-8")
            case "line":
                source = path.read_text(encoding="utf-8")
                path.write_text(inserted(source, name, text), encoding="utf-8")
            case _:
                assert mark in ("", "notest")
    ran = subprocess.run(
        [sys.executable, "-c", "import sys; exec(compile(sys.stdin.read(), 'extending', 'exec'))"],
        input=plain(EXTENDING),
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr


def inserted(source: str, name: str | None, text: str) -> str:
    """A module with lines put into a dictionary, a class or a function's dictionary; or on top."""
    lines = source.splitlines(keepends=True)
    body = ast.parse(source).body
    if name is None:
        after, margin = body[0].end_lineno or 0, ""
    else:
        (node,) = [node for node in body if ast.unparse(target(node)) == name]
        if isinstance(node, ast.ClassDef):
            after, margin = node.body[0].end_lineno or 0, " " * node.body[0].col_offset
        else:
            first = next(one for one in ast.walk(node) if isinstance(one, ast.Dict))
            entry = next(key for key in first.keys if key is not None)
            after, margin = first.lineno, " " * entry.col_offset
    return "".join([*lines[:after], indent(dedent(text), margin), *lines[after:]])


def target(node: ast.stmt) -> ast.AST:
    """What a statement of a module defines, as a name."""
    if isinstance(node, ast.ClassDef | ast.FunctionDef):
        return ast.Name(node.name)
    return node.target if isinstance(node, ast.AnnAssign) else node


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_code_that_is_not_run_can_be_parsed(page: Path) -> None:
    for _, mark, text in blocks(page, "python"):
        if mark == "notest":
            ast.parse(text)


# Commands --------------------------------------------------------------------------------------


def commands() -> list[str]:
    """Every command of the package that a page names, once."""
    found: dict[str, None] = {}
    for page in PAGES:
        lines = [*code_spans(page)]
        for _, _, text in blocks(page, "console"):
            joined = text.replace("\\\n", " ")
            lines += [line.removeprefix("$ ") for line in joined.splitlines()]
        for line in lines:
            command = re.sub(r" +# .*", "", line)
            if re.match(r"(robo47|python -m robo47_qp|python scenarios/\S+)( |$)", command):
                found.setdefault(command)
    return list(found)


class ParsedError(BaseException):
    """The command line was understood; nothing is run."""


@pytest.fixture
def only_parse(monkeypatch: pytest.MonkeyPatch) -> None:
    parse: Callable[..., Any] = tyro.cli

    def parsed(*args: Any, **options: Any) -> NoReturn:
        parse(*args, **options)
        raise ParsedError

    def opened(path: Path) -> NoReturn:
        raise ParsedError

    monkeypatch.setattr(tyro, "cli", parsed)
    monkeypatch.setattr(viewer, "open_recording", opened)
    monkeypatch.setattr(recovery, "recover", opened)


@pytest.mark.parametrize("command", commands())
@pytest.mark.usefixtures("only_parse")
def test_a_command_and_its_options_exist(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = [PLACEHOLDERS.get(word, word) for word in shlex.split(command)]
    if words[:3] == ["python", "-m", "robo47_qp"]:
        words = ["robo47", *words[3:]]
    monkeypatch.chdir(ROOT)
    if words[0] == "robo47" and len(words) < 3:
        words = [*words, "--help"]
    if "--help" in words:
        try:
            code: object = __main__.main(words[1:])
        except SystemExit as left:
            code = left.code
        assert code == 0
        return
    monkeypatch.setattr(sys, "argv", words[1:])
    with pytest.raises(ParsedError):
        __main__.main(words[1:]) if words[0] == "robo47" else run_script(words[1])


def run_script(path: str) -> None:
    runpy.run_path(path, run_name="__main__")


def test_there_are_commands_to_check() -> None:
    assert len(commands()) > 30


def test_targets_of_make_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    named = {name for page in LINKED for name in re.findall(r"make ([a-z-]+)`", prose(page))}
    named |= {
        name
        for page in PAGES
        for _, _, text in blocks(page, "console")
        for name in re.findall(r"\$ make ([a-z-]+)", text)
    }
    assert named >= {"reproduce", "test"}
    assert named <= targets


# Links and names -------------------------------------------------------------------------------


def anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", LINKED, ids=page_id)
def test_relative_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        there = (page.parent / name).resolve() if name else page
        assert there.exists(), f"{page.name} links to {target}"
        if anchor:
            assert anchor in anchors(there), f"{page.name} links to {target}"


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_files_that_a_page_names_exist(page: Path) -> None:
    path = re.compile(r"(?<![\w/.])((?:robo47_qp|tasks|scenarios|tests|docs)/[\w/.*-]*)")
    text = page.read_text(encoding="utf-8")
    added = re.findall(r"^```\w+ file=(\S+)", text, re.MULTILINE)
    for name in set(path.findall(re.sub(r"[\w/.-]*<\w+>[\w/.-]*", "", text))) - {*added}:
        assert any(ROOT.glob(name.rstrip("./"))), f"{page.name} names {name}"


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_modules_that_a_page_names_exist(page: Path) -> None:
    for name in re.findall(r"`(robo47_qp(?:\.\w+)+)`", prose(page)):
        pkgutil.resolve_name(name)


def known_words() -> set[str]:
    sources = [
        *(ROOT / "robo47_qp").rglob("*.py"),
        *(ROOT / "tasks").rglob("*.py"),
        *(ROOT / "scenarios").rglob("*.py"),
    ]
    return {word for path in sources for word in re.findall(r"\w+", path.read_text("utf-8"))}


def test_names_in_capitals_are_names_of_the_code() -> None:
    known = known_words() | ELSEWHERE
    for page in PAGES:
        defined = " ".join(text for _, _, text in blocks(page, "python", "xml"))
        for span in code_spans(page):
            for word in re.findall(r"(?<![\w/.<-])[A-Z][a-z]+[A-Z0-9]\w*", span):
                assert word in known or word in defined, f"{page.name} names {word}"


def test_every_room_is_in_the_layout() -> None:
    rooms = {
        path.name
        for path in (ROOT / "robo47_qp").iterdir()
        if path.is_dir() and (path / "__init__.py").exists()
    }
    told = re.findall(r"^\| `(\w+)/` \|", (ROOT / "README.md").read_text("utf-8"), re.MULTILINE)
    assert sorted(told) == sorted(rooms)


def test_every_page_is_linked_from_the_readme() -> None:
    text = " ".join(page.read_text("utf-8") for page in PAGES)
    for page in PAGES[1:]:
        assert f"{page.name}" in text.replace(page_id(page), page.name)
    readme = (ROOT / "README.md").read_text("utf-8")
    assert all(f"docs/{name}.md" in readme for name in ("ik", "motion", "control", "tasks"))
    assert all(f"docs/{name}.md" in readme for name in ("evaluation", "recordings", "results"))


def test_the_readme_is_read_to_its_end() -> None:
    assert len((ROOT / "README.md").read_bytes()) <= 8192


def test_every_cause_of_failure_is_in_the_table() -> None:
    text = (ROOT / "docs" / "tasks.md").read_text(encoding="utf-8")
    rows = text.partition("| cause | what happened |")[2].partition("\n\n")[0]
    assert re.findall(r"^\| `(\w+)`", rows, re.MULTILINE) == [cause.value for cause in Cause]


def test_every_page_tells_how_often_a_search_is_restarted() -> None:
    told = [
        found
        for page in PAGES
        for found in re.findall(r"restarted up to (\d+) times", page.read_text(encoding="utf-8"))
    ]
    assert told
    assert set(told) == {str(MultiStart(solver=LmIk()).max_restarts)}


def test_help_says_what_is_done(capsys: pytest.CaptureFixture[str]) -> None:
    def told(*command: str) -> str:
        with pytest.raises(SystemExit):
            __main__.main([*command, "--help"])
        return " ".join(re.sub(r"[│\s]+", " ", capsys.readouterr().out).split())

    assert re.search(r"--no-observer Take the measured state as it is", told("run"))
    assert "if none is named all of them, but only uniform and near_limits" in told("compare-ik")
