"""The shape of the code: imports point downwards, and rules that no tool checks."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "robo47_qp"
FRONT_DOOR = ROOT / PACKAGE / "__init__.py"
ROOMS: tuple[tuple[str, ...], ...] = (
    ("errors",),
    ("arrays", "files", "constants"),
    ("_core",),
    ("model",),
    ("collision",),
    ("ik",),
    ("motion",),
    ("control",),
    ("sim",),
    ("run",),
    ("report",),
    ("stack", "cli"),
    ("evaluation",),
)
"""From the bottom to the top: a module imports from rooms below its own, or from its own."""
ONLY_IN = {
    "cffi": {"_core.build"},
    "pylibfranka": {"sim.franka.link"},
    "ruckig": {"motion.timing"},
    "daqp": {"ik.box_qp"},
    "ompl": {"motion.detour"},
    "osqp": {"ik.box_qp"},
    "qpsolvers": {"ik.box_qp"},
    "platformdirs": {"ik.seeds"},
    "rerun": {"report.rerun", "evaluation.benchmarks"},
    "matplotlib": {"report.drawing", "evaluation.report.plots", "evaluation.benchmarks"},
    "imageio": {"report.video"},
    "imageio_ffmpeg": {"report.video"},
    "mujoco_menagerie": {"model.menagerie"},
    "tyro": {"cli", "evaluation.options"},
    "gymnasium": {"evaluation.gym"},
    "msgpack": {"evaluation.serving.messages"},
    "websockets": {"evaluation.serving"},
    "ray": {"evaluation.workers.ray_cluster"},
    "pydrake": {"evaluation.benchmarks.ik.peers"},
    "pink": {"evaluation.benchmarks.ik.peers"},
    "pinocchio": {"evaluation.benchmarks.ik.peers"},
    "optik": {"evaluation.benchmarks.ik.peers"},
    "roboticstoolbox": {"evaluation.benchmarks.ik.peers"},
}
"""Modules and rooms of the package that may import a library."""
TASKS_MAY_USE = {
    "arrays",
    "errors",
    "model.gripper",
    "model.obstacle",
    "model.payload",
    "model.tool_poses",
    "motion.waypoint",
    "run.compliance",
    "run.contact_steps",
    "run.failure",
    "run.follow_step",
    "run.steps",
    "run.task",
    "sim.sensed",
    "sim.simulation",
}
SEEDS_POLICIES = f"{PACKAGE}.run.policy.child"
"""Seeds the generators that policies share, in their process, and draws nothing."""
MAX_LINES = 400
MAX_ROOMS, MAX_MODULES = 10, 8
"""At the top of the package, the tasks that an installed package brings along included."""


def files(folder: str) -> list[Path]:
    """Python files of a folder; `robo47_qp/tasks` is a link to `tasks`, and counts as that."""
    linked = ROOT / PACKAGE / "tasks"
    found = sorted((ROOT / folder).rglob("*.py"))
    return [path for path in found if linked not in path.parents]


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
    return f"{PACKAGE}.{name}" if parts[0] == "tasks" else name


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


MODULES = {
    module_name(path) for folder in (PACKAGE, "tasks", "scenarios") for path in files(folder)
}


@cache
def imported(path: Path) -> tuple[str, ...]:
    """Full names of all that a file imports, wherever in it."""
    return tuple(_imported(path))


def _imported(path: Path) -> Iterator[str]:
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert node.module is not None
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in MODULES else node.module
        elif isinstance(node, ast.Call) and last_name(node.func) == "import_module":
            name = node.args[0]
            if path == FRONT_DOOR and not isinstance(name, ast.Constant):
                continue  # its names are imported above, for the type checker
            assert isinstance(name, ast.Constant), f"{path}: import of a computed name"
            yield str(name.value)


def last_name(node: ast.expr) -> str | None:
    """Last part of a name with dots; to unparse every call takes a second."""
    match node:
        case ast.Attribute(attr=name) | ast.Name(id=name):
            return name
    return None


def within(module: str) -> str | None:
    """Name inside the package; None for what is outside, and for the package itself."""
    return module.removeprefix(f"{PACKAGE}.") if module.startswith(f"{PACKAGE}.") else None


def rank(inside: str) -> int:
    room = inside.split(".", maxsplit=1)[0]
    found = [i for i, rooms in enumerate(ROOMS) if room in rooms]
    assert len(found) == 1, f"{room} stands in {len(found)} places: put it in one of ROOMS"
    return found[0]


def test_imports_point_downwards() -> None:
    for path, name in ((file, name) for file in files(PACKAGE) for name in imported(file)):
        own = within(module_name(path))
        assert name.split(".")[0] not in ("tasks", "scenarios", "tests"), f"{path} imports {name}"
        other = within(name)
        assert other is None or other.split(".")[0] != "tasks", f"{path} imports {name}"
        # The face of the package, and the command `robo47`, see all of it.
        if other is not None and own not in (None, "__main__"):
            assert rank(other) <= rank(own), f"{own} must not import {other}"


def test_every_room_is_there_and_the_top_is_small() -> None:
    top = sorted(path.name for path in (ROOT / PACKAGE).iterdir() if path.name[0] != "_")
    assert (ROOT / PACKAGE / "_core").is_dir()  # private: no room that people look into
    rooms = [name for name in top if (ROOT / PACKAGE / name).is_dir()]
    modules = list((ROOT / PACKAGE).glob("*.py"))
    assert {room for group in ROOMS for room in group} - {"_core"} == {
        name.removesuffix(".py") for name in top if name not in ("tasks", "py.typed")
    }
    assert len(rooms) <= MAX_ROOMS
    assert len(modules) <= MAX_MODULES


def test_imports_make_no_circle() -> None:
    graph = {
        module_name(path): {n for n in imported(path) if n in MODULES} - {PACKAGE}
        for path in files(PACKAGE)
        if path != FRONT_DOOR
    }
    done: set[str] = set()

    def visit(module: str, way: tuple[str, ...]) -> None:
        assert module not in way, " -> ".join((*way, module))
        if module not in done:
            for other in graph[module]:
                visit(other, (*way, module))
            done.add(module)

    for module in graph:
        visit(module, ())


def test_tasks_know_no_solver_gain_or_robot() -> None:
    for path, name in ((file, name) for file in files("tasks") for name in imported(file)):
        inside = within(name)
        own = inside is not None and inside.split(".")[0] == "tasks"
        assert inside is None or own or inside in TASKS_MAY_USE, f"{path} must not import {name}"
        assert name.split(".")[0] not in ("scenarios", "tests")


@pytest.mark.parametrize("library", ONLY_IN)
def test_a_library_is_used_in_its_place_only(library: str) -> None:
    users = {
        str(within(module_name(path)))
        for path in files(PACKAGE)
        if any(name.split(".")[0] == library for name in imported(path))
    }
    places = ONLY_IN[library]
    assert users
    assert not [u for u in users if not any(f"{u}.".startswith(f"{place}.") for place in places)]
    for folder in ("tasks", "scenarios"):
        for path in files(folder):
            if "judges" in path.parts:
                continue  # clients that run without the package
            assert library not in {name.split(".")[0] for name in imported(path)}


CODE = [path for folder in (PACKAGE, "tasks", "scenarios") for path in files(folder)]


def test_house_rules() -> None:
    for path, node in ((file, node) for file in CODE for node in ast.walk(tree(file))):
        where = f"{path.name}:{getattr(node, 'lineno', 0)}"
        assert not isinstance(node, ast.Assert), f"{where}: raise instead of assert"
        if isinstance(node, ast.ExceptHandler):
            caught = ast.unparse(node.type) if node.type is not None else "everything"
            broad = {"everything", "Exception", "BaseException"}
            assert not broad & set(caught.strip("()").replace(",", "").split()), where


def calls_at_import(path: Path) -> Iterator[str]:
    """Functions called when a module is imported, outside functions and classes' methods."""
    pending: list[ast.AST] = [node for node in tree(path).body if not _is_main_guard(node)]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.FunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func)
        pending.extend(ast.iter_child_nodes(node))


def _is_main_guard(node: ast.stmt) -> bool:
    return isinstance(node, ast.If) and "__name__" in ast.unparse(node.test)


def test_randomness_is_passed_in() -> None:
    for path in CODE:
        called = [name for name in calls_at_import(path) if "random" in name or "rng" in name]
        assert not called, path
        source = path.read_text(encoding="utf-8")
        # Written anew without comments where there is something to find.
        text = ast.unparse(tree(path)) if re.search(r"np\.random|RandomState", source) else source
        if module_name(path) == SEEDS_POLICIES:
            assert set(re.findall(r"random\.(\w+)", text)) == {"seed"}
            continue
        for hidden in ("np.random.seed", "np.random.uniform", "np.random.normal", "RandomState"):
            assert hidden not in text, path
        assert "random" not in {name.split(".")[0] for name in imported(path)}, path


C_FILES = sorted((ROOT / PACKAGE / "_core").glob("*.[ch]"))


def test_a_file_is_short() -> None:
    lengths = {
        path: len(path.read_text(encoding="utf-8").splitlines())
        for path in (*files(PACKAGE), *C_FILES)
    }
    assert not {path: lines for path, lines in lengths.items() if lines > MAX_LINES}


def test_the_test_finds_what_it_looks_for(tmp_path: Path) -> None:
    """The eyes of this file, tried on code that breaks the rules."""
    path = tmp_path / "bad.py"
    path.write_text(
        "import numpy as np\nfrom robo47_qp.run import runner\nRNG = np.random.default_rng(0)\n"
        "def f():\n    import ruckig\n    from importlib import import_module\n"
        "    return import_module('rerun')\n"
    )
    assert {"robo47_qp.run.runner", "ruckig", "rerun", "numpy"} <= set(imported(path))
    assert list(calls_at_import(path)) == ["np.random.default_rng"]
    assert rank("ik.qp") < rank("motion.planner") < rank("run.runner") < rank("cli")
