"""The Rerun file: what is in it, what it refuses, and what is left when writing ends badly."""

import signal
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import mujoco
import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
from mink import SE3
from rerun.chunk import RrdReader

from robo47_qp.constants import TIMESTEP
from robo47_qp.errors import RecordingError
from robo47_qp.ik.qp import QpIk
from robo47_qp.model.arm import Arm
from robo47_qp.model.robots.panda import PANDA
from robo47_qp.motion.planner import Planner
from robo47_qp.motion.waypoint import Waypoint, tool_down
from robo47_qp.report.rerun.columns import component
from robo47_qp.report.rerun.log import RerunLog
from robo47_qp.report.rerun.reading import Note, read_recording, read_recordings
from robo47_qp.report.rerun.stream import RerunStream
from robo47_qp.run import signals
from robo47_qp.run.recording import Rows
from robo47_qp.sim.simulation import Simulation
from robo47_qp.tasks.pick_place.pick_place import PickPlace
from tests.robots import GRIPPER

Table: TypeAlias = dict[str, list[Any]]

SIGNALS = signals.all_signals(Simulation(PANDA, PickPlace().build_scene))
LEFT_OUT = {
    "time",
    "phase",
    "motion/cube velocity",
    "motion/cube acceleration",
    "gripper/fingers",
    "gripper/left_finger_contact",
    "gripper/right_finger_contact",
}
LOGGED = [found for found in SIGNALS if found.name not in LEFT_OUT]


@pytest.fixture(scope="module")
def world() -> Simulation:
    return Simulation(PANDA, PickPlace().build_scene)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "new" / "folder" / "run.rrd"


@pytest.fixture
def log(world: Simulation, path: Path) -> Iterator[RerunLog]:
    made = RerunLog(path, world.model, PANDA, SIGNALS)
    yield made
    made.close()


def block(first: int, count: int = 250) -> Rows:
    """Rows of noise, possible as poses, from row number `first` on."""
    rng = np.random.default_rng(first)
    rows = Rows(SIGNALS, rng.normal(size=(count, sum(len(s.labels) for s in SIGNALS))))
    rows["time"][:, 0] = (first + np.arange(count)) * TIMESTEP
    for name in ("tool/pose", "tool/pose_ref", "objects/cube"):
        rows[name][:, 3:] /= np.linalg.norm(rows[name][:, 3:], axis=1, keepdims=True)
    return rows


def read(path: Path, entity: str) -> Table:
    """All values of an entity's columns; instants in nanoseconds."""
    table: Table = defaultdict(list)
    for chunk in RrdReader(path).stream().to_chunks():
        if str(chunk.entity_path) == entity:
            batch = chunk.to_record_batch()
            for name in batch.schema.names:
                values = batch.column(name)
                if name == "time":
                    instants = values.to_numpy(zero_copy_only=False)
                    table[name] += instants.astype("timedelta64[ns]").astype(np.int64).tolist()
                else:
                    table[name] += values.to_pylist()
    return table


def assert_holds(found: Rows, rows: Rows) -> None:
    assert found["time"][:, 0].tolist() == [round(1e9 * t) / 1e9 for t in rows["time"][:, 0]]
    logged = {signal.name: signal for signal in found.signals if signal.name != "time"}
    assert logged == {signal.name: signal for signal in LOGGED}
    for name in logged:
        np.testing.assert_array_equal(found[name], rows[name])


def test_every_number_comes_back_at_its_instant(log: RerunLog, path: Path) -> None:
    blocks = [block(0), block(250), block(500, 30)]
    for rows in blocks:
        log.write(rows)
    log.finish("done")
    assert_holds(
        read_recording(path).rows, Rows(SIGNALS, np.concatenate([rows.values for rows in blocks]))
    )


def test_what_others_tell_is_left_out(log: RerunLog, path: Path) -> None:
    log.write(block(0))
    log.finish("done")
    table = read(path, "/signals")
    described = ("labels:", "units:", "rerun.")
    columns = {name for name in table if not name.startswith(described)} - {"time"}
    assert columns == {component(found.name) for found in LOGGED}
    assert table["labels:joints/q"] == [list(PANDA.joints)]
    assert table["units:joints/tau"] == [["N·m"]]


def test_a_row_costs_little_more_than_its_numbers(log: RerunLog, path: Path) -> None:
    empty = path.stat().st_size
    for first in range(0, 5000, 250):
        log.write(block(first))
    log.finish("done")
    numbers = sum(8 * len(found.labels) for found in LOGGED)
    # Beside them: row id and instant (24 bytes), the scene at 60 Hz, the index of the file.
    assert (path.stat().st_size - empty) / 5000 < numbers + 180


def test_bodies_are_where_mujoco_has_them(log: RerunLog, path: Path, world: Simulation) -> None:
    rows = block(0)
    log.write(rows)
    log.finish("done")
    table = read(path, "/frames")
    data = mujoco.MjData(world.model)
    seen = set()
    for instant, child, position, xyzw in zip(
        table["time"],
        table["Transform3D:child_frame"],
        table["Transform3D:translation"],
        table["Transform3D:quaternion"],
        strict=True,
    ):
        row = round(1e-9 * instant / TIMESTEP)
        for names, name in ((PANDA.joints, "joints/q"), (GRIPPER.joints, "gripper/fingers")):
            for joint, value in zip(names, rows[name][row], strict=True):
                data.joint(joint).qpos = value
        data.qpos[world.model.jnt_qposadr[world.model.body("cube").jntadr[0]] :][:7] = rows[
            "objects/cube"
        ][row]
        mujoco.mj_kinematics(world.model, data)
        if child == ["tool"]:
            expected, wxyz = rows["tool/pose"][row, :3], rows["tool/pose"][row, 3:]
        else:
            expected, wxyz = data.body(child[0]).xpos, data.body(child[0]).xquat
        np.testing.assert_allclose(position[0], expected, atol=1e-6)
        np.testing.assert_allclose(np.roll(xyzw[0], 1), wxyz, atol=1e-6)
        seen.add((row, child[0]))
    moving = {"tool", "cube", "hand", *GRIPPER.fingers, *(f"link{i}" for i in range(1, 8))}
    instants = {row for row, _ in seen}
    assert seen == {(row, name) for row in instants for name in moving}
    assert max(np.diff(sorted(instants))) == 17  # 60 Hz


def test_the_course_of_a_run_is_told(log: RerunLog, path: Path, world: Simulation) -> None:
    arm = Arm(PANDA)
    planner = Planner(ik=QpIk(), profile=PANDA.profile)
    goal = tool_down([0.5, 0.1, 0.3])
    leg = planner.plan(arm, Waypoint(name="above", target=goal), PANDA.home, TIMESTEP)
    world.place_marker("goal", SE3.from_translation(np.array([0.1, 0.2, 0.3])))
    log.phase(0.0, "above")
    one = leg.tool_paths(arm)["tool"]
    log.planned(0.0, leg, {"tool": one, "other": one + np.array([0.0, 0.0, 1.0])})
    log.tick(world)
    log.tick(world)
    log.write(block(0))
    log.note(0.5, "lost the cube", "WARN")
    log.finish("# Well done")
    assert read(path, "/phases")["StateChange:state"] == [["above"]]
    events = read(path, "/events")
    assert events["TextLog:level"] == [["INFO"], ["WARN"]]
    assert events["TextLog:text"][0][0].startswith("0.00 s  PTP to 'above', ")
    assert events["TextLog:text"][1] == ["0.50 s  lost the cube"]
    assert events["time"] == [0, 500_000_000]
    strips = read(path, "/planned")["LineStrips3D:strips"][0]
    for strip in (strips[0], np.subtract(strips[len(strips) // 2], [0.0, 0.0, 1.0])):
        np.testing.assert_allclose(strip[0], arm.pose(PANDA.home).translation(), atol=1e-6)
    origins = read(path, "/goals")["Arrows3D:origins"][0]
    np.testing.assert_allclose(origins, [goal.translation()] * 3, atol=1e-6)
    markers = read(path, "/frames/markers")
    np.testing.assert_allclose(markers["Transform3D:translation"], [[[0.1, 0.2, 0.3]]], atol=1e-6)
    run = read_recording(path)
    assert run.summary == "# Well done"
    assert run.phases == [(0.0, "above")]
    assert run.notes[1] == Note(time=0.5, level="WARN", text="0.50 s  lost the cube")
    assert run.notes[0].text == events["TextLog:text"][0][0]


def test_what_cannot_be_read_is_told(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    with pytest.raises(RecordingError, match=r"run\.rrd cannot be read: there is no such file"):
        read_recording(path)
    path.write_text("no recording")
    with pytest.raises(RecordingError, match="it is not a Rerun recording, or it is damaged"):
        read_recording(path)
    stream = RerunStream(path, "other", rrb.Blueprint(), None)
    stream.log("signals", rr.TextLog("no signals"), time=0.0)
    stream.finish(0.0)
    with pytest.raises(RecordingError, match="does not hold the signals of a run"):
        read_recording(path)


def test_a_torn_file_is_refused_with_what_repairs_it(log: RerunLog, path: Path) -> None:
    log.write(block(0))
    log.finish("done")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(RecordingError, match=r"damaged(.|\n)*rerun rrd optimize .*run\.rrd"):
        read_recording(path)


def test_several_runs_in_a_file_are_read_one_by_one(world: Simulation, tmp_path: Path) -> None:
    files = [str(tmp_path / f"{name}.rrd") for name in ("a", "b", "both")]
    for first, file in zip((0, 250), files, strict=False):
        log = RerunLog(Path(file), world.model, PANDA, SIGNALS)
        log.write(block(first))
        log.finish(f"run {first}")
    command = [sys.executable, "-m", "rerun", "rrd", "merge", *files[:2], "-o", files[2]]
    subprocess.run(command, check=True, capture_output=True)
    runs = {run.summary: run for run in read_recordings(Path(files[2]))}
    assert set(runs) == {"run 0", "run 250"}
    assert_holds(runs["run 250"].rows, block(250))
    with pytest.raises(RecordingError, match="holds 2 runs; read them with read_recordings"):
        read_recording(Path(files[2]))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_no_number_is_refused(log: RerunLog, path: Path, value: float) -> None:
    log.write(block(0))
    rows = block(250)
    rows["joints/tau"][7, 2] = value
    message = rf"'joints/tau' cannot be recorded at 0\.257 s: its joint3 is {value}"
    with pytest.raises(RecordingError, match=message):
        log.write(rows)
    log.finish("done")
    assert_holds(read_recording(path).rows, block(0))


@pytest.mark.parametrize("factor", [0.0, 1.001])
def test_a_quaternion_without_unit_length_is_refused(log: RerunLog, factor: float) -> None:
    rows = block(0)
    rows["objects/cube"][20, 3:] *= factor
    with pytest.raises(RecordingError, match=rf"at 0\.020 s: its quaternion has length {factor:g}"):
        log.write(rows)


def test_a_file_that_cannot_be_made_is_known_at_once(world: Simulation, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path, reason in (
        (tmp_path, "Is a directory"),
        (tmp_path / "file" / "run.rrd", "its folder is a file"),
        (Path("/proc/nothing/run.rrd"), "No such file or directory"),
        (Path("/dev/full"), "No space left on device"),
    ):
        with pytest.raises(RecordingError, match=reason):
            RerunLog(path, world.model, PANDA, SIGNALS)


def test_a_closed_recording_says_so(log: RerunLog) -> None:
    log.finish("done")
    log.close()
    log.close()
    with pytest.raises(RecordingError, match=r"run\.rrd is closed"):
        log.write(block(0))


def test_a_file_that_went_away_is_no_success(log: RerunLog, path: Path) -> None:
    log.write(block(0))
    path.unlink()
    with pytest.raises(RecordingError, match=r"run\.rrd could not be written to its end"):
        log.finish("done")


def write_elsewhere(path: Path, last_words: str) -> subprocess.CompletedProcess[str]:
    """Write 12 blocks in another process, with `last_words` run at its start."""
    program = f"""
import os, resource, signal, sys
from pathlib import Path
from tests.report.rerun.test_rerun_log import PANDA, SIGNALS, PickPlace, RerunLog, Simulation, block
path = Path({str(path)!r})
log = RerunLog(path, Simulation(PANDA, PickPlace().build_scene).model, PANDA, SIGNALS)
{last_words}
"""
    root = Path(__file__).resolve().parents[3]
    return subprocess.run(
        [sys.executable, "-c", program],
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


def test_a_full_disk_is_reported_and_what_was_written_is_readable(path: Path) -> None:
    ended = write_elsewhere(
        path,
        """
resource.setrlimit(resource.RLIMIT_FSIZE, (17_300_000, 17_300_000))
for first in range(0, 10_000, 250):
    log.write(block(first))
""",
    )
    assert "RecordingError: " in ended.stderr
    assert "there is room for only 16 MB more" in ended.stderr
    table = read_recording(path).rows
    kept = len(table)
    assert kept >= 250
    assert f"run.rrd was closed at {(kept - 1) * TIMESTEP:.3f} s" in ended.stderr
    blocks = [block(first).values for first in range(0, kept, 250)]
    assert_holds(table, Rows(SIGNALS, np.concatenate(blocks)))


def test_a_write_that_fails_is_reported_and_the_process_ends(path: Path) -> None:
    ended = write_elsewhere(
        path,
        """
from robo47_qp.report.rerun import stream
stream._RESERVE = -1e9  # as if the space went away between two looks
stream._PATIENCE = 1.0
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1_300_000, 1_300_000))
for first in range(0, 10_000, 250):
    log.write(block(first))
""",
    )
    assert "RecordingError: " in ended.stderr
    assert "run.rrd could not be written to its end" in ended.stderr


def test_a_disk_that_is_full_at_the_very_end_is_reported(path: Path) -> None:
    ended = write_elsewhere(
        path,
        """
log.write(block(0))
log._stream.flush(0.249)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
size = path.stat().st_size + 4000
resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
log.finish("done")
""",
    )
    assert "RecordingError: " in ended.stderr
    assert "run.rrd could not be written to its end" in ended.stderr


def test_a_killed_process_leaves_all_but_the_last_moments(path: Path) -> None:
    ended = write_elsewhere(
        path,
        """
import time
for first in range(0, 3000, 250):
    log.write(block(first))
    time.sleep(0.1)
os.kill(os.getpid(), signal.SIGKILL)
""",
    )
    assert ended.returncode == -signal.SIGKILL
    table = read_recording(path).rows
    kept = len(table)
    assert kept >= 3000 - 250
    blocks = [block(first).values for first in range(0, kept, 250)]
    assert_holds(table, Rows(SIGNALS, np.concatenate(blocks)))
