"""The shape of the code: imports point downwards, and rules that no tool checks."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "robo47_qp"
LAYERS: tuple[tuple[str, ...], ...] = (
    ("errors",),
    ("arrays", "comparison", "files", "guard", "json_file", "statistics"),
    ("obstacle", "robot", "waypoint"),
    ("menagerie", "robot_model"),
    ("arm_model",),
    ("robots.*", "arm"),
    ("ik.*",),
    ("motion.*", "tool_motion"),
    ("controllers.*", "contact_sensing", "camera", "scene"),
    ("robot_defaults", "simulated_gripper", "simulated_motors", "simulated_objects"),
    ("disturbance", "robot_loading", "simulation", "visuals"),
    ("failure", "recording", "steps"),
    ("policy", "policy_action"),
    ("task", "watch"),
    ("signals", "run"),
    ("closest_approach", "finding", "smoothness"),
    ("metrics", "audit", "audit_contact", "audit_tool", "plots", "settling", "comparison_page"),
    ("report",),
    ("observer",),
    ("body_poses", "live_viewer", "rerun_columns", "rerun_scene", "rerun_stream"),
    ("rerun_blueprint",),
    ("rerun_log",),
    ("pacing", "terminal", "video"),
    ("loop",),
    ("step_failures",),
    ("following", "touching"),
    ("actions",),
    ("policy_motion",),
    ("policy_cell",),
    ("runner",),
    ("policy_runner",),
    ("stepwise",),
    ("options", "settling_study"),
    ("gym_spaces",),
    ("gym_env", "command"),
    ("ik_benchmark.*", "control_benchmark.*", "evaluation.*"),
)
"""From the bottom to the top: a module imports from lower layers, or from its own."""
ONLY_IN = {
    "ruckig": {"motion.jerk_limited", "motion.leap"},
    "daqp": {"ik.box_qp"},
    "ompl": {"motion.detour"},
    "osqp": {"ik.box_qp"},
    "qpsolvers": {"ik.box_qp"},
    "platformdirs": {"ik.library"},
    "rerun": {
        "live_viewer",
        "rerun_blueprint",
        "rerun_columns",
        "rerun_log",
        "rerun_scene",
        "rerun_stream",
        "ik_benchmark.failure_log",
        "ik_benchmark.failure_pages",
        "control_benchmark.trial_log",
    },
    "matplotlib": {"plots", "ik_benchmark.plots", "control_benchmark.plots", "evaluation.plots"},
    "imageio": {"video"},
    "imageio_ffmpeg": {"video"},
    "mujoco_menagerie": {"menagerie"},
    "tyro": {"command"},
    "gymnasium": {"gym_env", "gym_spaces"},
    "ray": {"evaluation.ray_cluster"},
    "pydrake": {"ik.peers.drake"},
    "pink": {"ik.peers.pink"},
    "pinocchio": {"ik.peers.pink"},
    "optik": {"ik.peers.optik"},
    "roboticstoolbox": {"ik.peers.toolbox"},
}
"""Modules of the package that may import a library."""
TASKS_MAY_USE = {"errors", "failure", "obstacle", "simulation", "steps", "task", "waypoint"}
MAX_LINES = 250


def files(folder: str) -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


MODULES = {
    module_name(path) for folder in (PACKAGE, "tasks", "scenarios") for path in files(folder)
}


def imported(path: Path) -> Iterator[str]:
    """Full names of all that a file imports, wherever in it."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert node.module is not None
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in MODULES else node.module
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            name = node.args[0]
            assert isinstance(name, ast.Constant), f"{path}: import of a computed name"
            yield str(name.value)


def within(module: str) -> str | None:
    """Name inside the package; None for what is outside, and for the package itself."""
    return module.removeprefix(f"{PACKAGE}.") if module.startswith(f"{PACKAGE}.") else None


def layer(inside: str) -> int:
    found = [
        i
        for i, names in enumerate(LAYERS)
        for name in names
        if inside == name or (name.endswith(".*") and f"{inside}.".startswith(name[:-1]))
    ]
    assert len(found) == 1, f"{inside} stands in {len(found)} layers: put it in one of LAYERS"
    return found[0]


@pytest.mark.parametrize("path", files(PACKAGE), ids=module_name)
def test_imports_point_downwards(path: Path) -> None:
    own = within(module_name(path))
    for name in imported(path):
        assert name.split(".")[0] not in ("tasks", "scenarios", "tests"), f"{path} imports {name}"
        other = within(name)
        if other is not None:
            assert own is not None
            assert layer(other) <= layer(own), f"{own} must not import {other}"


def test_every_layer_is_still_there() -> None:
    inside = {name for module in MODULES if (name := within(module)) is not None}
    for names in LAYERS:
        for name in names:
            assert any(m == name or f"{m}.".startswith(name.removesuffix("*")) for m in inside)


def test_imports_make_no_circle() -> None:
    graph = {
        module_name(path): {n for n in imported(path) if n in MODULES} - {PACKAGE}
        for path in files(PACKAGE)
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


@pytest.mark.parametrize("path", files("tasks"), ids=module_name)
def test_tasks_know_no_solver_gain_or_robot(path: Path) -> None:
    for name in imported(path):
        inside = within(name)
        assert inside is None or inside in TASKS_MAY_USE, f"{path.name} must not import {name}"
        assert name.split(".")[0] not in ("scenarios", "tests")


@pytest.mark.parametrize("library", ONLY_IN)
def test_a_library_is_used_in_its_place_only(library: str) -> None:
    users = {
        str(within(module_name(path)))
        for path in files(PACKAGE)
        if any(name.split(".")[0] == library for name in imported(path))
    }
    assert users
    assert users <= ONLY_IN[library]
    for folder in ("tasks", "scenarios"):
        for path in files(folder):
            assert library not in {name.split(".")[0] for name in imported(path)}


CODE = [path for folder in (PACKAGE, "tasks", "scenarios") for path in files(folder)]


@pytest.mark.parametrize("path", CODE, ids=module_name)
def test_house_rules(path: Path) -> None:
    for node in ast.walk(tree(path)):
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


@pytest.mark.parametrize("path", CODE, ids=module_name)
def test_randomness_is_passed_in(path: Path) -> None:
    assert not [name for name in calls_at_import(path) if "random" in name or "rng" in name]
    text = ast.unparse(tree(path))
    for hidden in ("np.random.seed", "np.random.uniform", "np.random.normal", "RandomState"):
        assert hidden not in text
    assert "random" not in {name.split(".")[0] for name in imported(path)}


@pytest.mark.parametrize("path", files(PACKAGE), ids=module_name)
def test_a_file_is_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) < MAX_LINES


def test_the_test_finds_what_it_looks_for(tmp_path: Path) -> None:
    """The eyes of this file, tried on code that breaks the rules."""
    path = tmp_path / "bad.py"
    path.write_text(
        "import numpy as np\nfrom robo47_qp import runner\nRNG = np.random.default_rng(0)\n"
        "def f():\n    import ruckig\n    from importlib import import_module\n"
        "    return import_module('rerun')\n"
    )
    assert {"robo47_qp.runner", "ruckig", "rerun", "numpy"} <= set(imported(path))
    assert list(calls_at_import(path)) == ["np.random.default_rng"]
    assert layer("ik.qp") < layer("motion.planner") < layer("runner") < layer("command")
