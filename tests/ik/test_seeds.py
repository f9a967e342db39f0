import os
import pickle
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.ik import seeds as module
from robo47_qp.ik.seeds import SeedLibrary, feature_of, library_of
from robo47_qp.model.arm import Arm
from robo47_qp.model.payload import Payload
from robo47_qp.model.robot import Robot
from tests.examples import shifted
from tests.plain_arm import PlainArm, welded_file
from tests.robots import the_gripper

COUNT = 60


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder of this test alone; what is in memory belongs to other arms."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "robo47_qp"


def bits(library: SeedLibrary) -> tuple[bytes, bytes, bytes]:
    return library.q.tobytes(), library.feature.tobytes(), library.half_square.tobytes()


def only_file(cache: Path) -> Path:
    (path,) = cache.iterdir()
    return path


def feature(plain: PlainArm, q: Vector) -> Vector:
    position, R = plain.tool(q)
    return np.concatenate([position, 0.3 * R.ravel()])


def never(*_: object) -> None:
    pytest.fail("the library was made, and not read")


def test_a_feature_is_the_position_and_the_weighted_rotation(arm: Arm, plain: PlainArm) -> None:
    for at in (0.1, 0.5, 0.8):
        q = plain.at(np.full(8, at))
        assert feature_of(arm.pose(q)) == pytest.approx(feature(plain, q), abs=1e-6)


def test_a_quaternion_and_its_negative_have_one_feature(arm: Arm) -> None:
    numbers = arm.pose(arm.home).wxyz_xyz
    mirrored = SE3(numbers * np.array([-1.0] * 4 + [1.0] * 3))
    assert feature_of(mirrored).tolist() == feature_of(SE3(numbers)).tolist()


def test_every_configuration_has_the_feature_of_its_own_pose(
    cache: Path, robot: Robot, plain: PlainArm
) -> None:
    library = library_of(Arm(robot), COUNT)
    assert library.q.shape == (COUNT, plain.n)
    assert library.feature.shape == (COUNT, 12)
    for q, found, half in zip(library.q, library.feature, library.half_square, strict=True):
        assert plain.inside(q)
        expected = feature(plain, q)
        assert found == pytest.approx(expected, abs=1e-6)
        assert half == pytest.approx(0.5 * expected @ expected, abs=1e-5)


def test_fewer_configurations_are_the_first_of_many(cache: Path, robot: Robot) -> None:
    few, many = library_of(Arm(robot), 7), library_of(Arm(robot), COUNT)
    assert few.q.tolist() == many.q[:7].tolist()
    assert few.feature.tolist() == many.feature[:7].tolist()


def test_the_nearest_are_those_of_brute_force(arm: Arm, plain: PlainArm) -> None:
    library = library_of(arm, 500)
    features = np.array([feature(plain, q) for q in library.q])
    rng = np.random.default_rng(3)
    for _ in range(20):
        q = rng.uniform(plain.q_min, plain.q_max)
        target = shifted(arm.pose(q), rng.normal(scale=0.1, size=3))
        position, R = target.translation(), target.rotation().as_matrix()
        away = np.linalg.norm(features - np.concatenate([position, 0.3 * R.ravel()]), axis=1)
        distances = library.distances(feature_of(target))
        constant = distances - 0.5 * away**2
        assert np.ptp(constant) < 1e-5
        for count in (1, 2, 40, 500):
            near = list(library.nearest(distances, count))
            assert len(set(near)) == count
            assert away[near] == pytest.approx(np.sort(away)[:count], abs=1e-5)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 7, 9])
def test_equal_ones_come_in_their_order(arm: Arm, count: int) -> None:
    """At the edge of the choice too: argmin, for one, must be the first."""
    library = library_of(arm, 9)
    rng = np.random.default_rng(0)
    for _ in range(50):
        distances = rng.integers(0, 3, 9).astype(np.float32)
        expected = sorted(range(9), key=lambda k: (distances[k], k))[:count]
        assert list(library.nearest(distances, count)) == expected
    assert list(library.nearest(np.zeros(9, dtype=np.float32), count)) == list(range(count))


def test_many_equal_ones_come_in_their_order(arm: Arm) -> None:
    library = library_of(arm, 9)
    distances = np.zeros(3000, dtype=np.float32)
    distances[::3] = 1.0
    expected = [k for k in range(3000) if k % 3][:40]
    assert list(library.nearest(distances, 40)) == expected


def test_what_is_in_memory_is_given_again_and_cannot_be_written_to(
    cache: Path, robot: Robot
) -> None:
    arm = Arm(robot)
    library = library_of(arm, COUNT)
    assert library_of(arm, COUNT) is library
    assert library_of(arm, COUNT + 1) is not library
    for array in (library.q, library.feature, library.half_square):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_what_was_written_is_read(
    cache: Path, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = library_of(Arm(robot), COUNT)
    path = only_file(cache)
    before = path.stat()
    monkeypatch.setattr(module, "_made", never)
    read = library_of(Arm(robot), COUNT)
    assert bits(read) == bits(made)
    assert path.stat().st_mtime_ns == before.st_mtime_ns
    for array in (read.q, read.feature, read.half_square):
        assert not array.flags.writeable


def test_another_process_has_the_same_bits_read_or_made(cache: Path, robot: Robot) -> None:
    made = library_of(Arm(robot), COUNT)
    path = only_file(cache)
    question = (
        "import pickle, sys\n"
        "from hashlib import sha256\n"
        "from robo47_qp.model.arm import Arm\n"
        "from robo47_qp.ik import seeds as module\n"
        "robot = pickle.loads(sys.stdin.buffer.read())\n"
        f"for count in ({COUNT}, {COUNT}):\n"
        "    library = module.library_of(Arm(robot), count)\n"
        "    parts = (library.q, library.feature, library.half_square)\n"
        "    print(sha256(b''.join(part.tobytes() for part in parts)).hexdigest())\n"
        "    module.Path.unlink(next(module.user_cache_path('robo47_qp').iterdir()))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", question],
        input=pickle.dumps(robot),
        capture_output=True,
        env={**os.environ, "XDG_CACHE_HOME": str(cache.parent)},
        check=True,
    )
    expected = sha256(b"".join(bits(made))).hexdigest()
    assert done.stdout.decode().split() == [expected, expected]
    assert not path.exists()


def foreign(path: Path) -> None:
    np.savez(path.with_suffix(""), q=np.zeros((COUNT, 7)), feature=np.zeros((COUNT, 12)))
    path.with_suffix(".npz").replace(path)


DAMAGE: dict[str, Callable[[Path], object]] = {
    "empty": lambda path: path.write_bytes(b""),
    "one byte": lambda path: path.write_bytes(b"P"),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "half": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "longer": lambda path: path.write_bytes(path.read_bytes() + b"\0"),
    "zeros": lambda path: path.write_bytes(bytes(path.stat().st_size)),
    "text": lambda path: path.write_text("not a library\n" * 1000),
    "archive": foreign,
    "pickle": lambda path: path.write_bytes(b"\x80\x04\x95" + b"." * 100),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE.keys())
def test_a_file_that_is_not_what_was_written_is_made_anew(
    cache: Path, robot: Robot, damage: Callable[[Path], object]
) -> None:
    made = library_of(Arm(robot), COUNT)
    path = only_file(cache)
    good = path.read_bytes()
    damage(path)
    assert path.read_bytes() != good
    assert bits(library_of(Arm(robot), COUNT)) == bits(made)
    assert path.read_bytes() == good
    assert only_file(cache) == path


def test_one_bit_anywhere_is_noticed(cache: Path, robot: Robot) -> None:
    made = library_of(Arm(robot), COUNT)
    path = only_file(cache)
    good = path.read_bytes()
    for place in np.linspace(0, len(good) - 1, 12).astype(int):
        bad = bytearray(good)
        bad[place] ^= 1 << (place % 8)
        path.write_bytes(bytes(bad))
        assert bits(library_of(Arm(robot), COUNT)) == bits(made)
        assert path.read_bytes() == good


def changed(robot: Robot, folder: Path, change: Callable[[ET.Element], None]) -> Robot:
    path = welded_file(robot, folder)
    root = ET.fromstring(path.read_text(encoding="utf-8"))
    change(root)
    path.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    types = {joint.get("name"): joint.get("type") for joint in root.iter("joint")}
    slides = tuple(name for name in robot.joints if types[name] == "slide")
    return replace(robot, mjcf=path, slides=slides)


def of_joint(i: int, **values: str) -> Callable[[Robot, ET.Element], None]:
    def change(robot: Robot, root: ET.Element) -> None:
        joints = {joint.get("name"): joint for joint in root.iter("joint")}
        joints[robot.joints[i]].attrib.update(values)

    return change


def of_tool(**values: str) -> Callable[[Robot, ET.Element], None]:
    def change(robot: Robot, root: ET.Element) -> None:
        (site,) = (site for site in root.iter("site") if site.get("name") == robot.tcp)
        for name in ("quat", "euler", "axisangle"):
            if name in values:
                for other in ("quat", "euler", "axisangle", "xyaxes", "zaxis"):
                    site.attrib.pop(other, None)
        site.attrib.update(values)

    return change


def of_link(**values: str) -> Callable[[Robot, ET.Element], None]:
    """The body of the third joint."""

    def change(robot: Robot, root: ET.Element) -> None:
        for body in root.iter("body"):
            if any(joint.get("name") == robot.joints[2] for joint in body.findall("joint")):
                if "quat" in values:
                    body.attrib.pop("euler", None)
                body.attrib.update(values)

    return change


OTHERS = {
    "a joint limit": of_joint(0, range="-1.5 1.5"),
    "an axis": of_joint(2, axis="0 0 -1"),
    "an anchor": of_joint(4, pos="0 0.01 0"),
    "a zero": of_joint(3, ref="0.1"),
    "a slide": of_joint(5, type="slide"),
    "the tool's place": of_tool(pos="0 0 0.3"),
    "the tool's frame": of_tool(quat="0.6 0.8 0 0"),
    "a link's length": of_link(pos="0 -0.4 0.01"),
    "a link's turn": of_link(quat="0.8 0 0.6 0"),
}


@pytest.mark.parametrize("change", OTHERS.values(), ids=OTHERS.keys())
def test_another_kinematics_has_another_file(
    cache: Path, robot: Robot, tmp_path: Path, change: Callable[[Robot, ET.Element], None]
) -> None:
    library_of(Arm(robot), COUNT)
    path = only_file(cache)
    other = changed(robot, tmp_path, lambda root: change(robot, root))
    library = library_of(Arm(other), COUNT)
    assert set(cache.iterdir()) > {path}
    plain = PlainArm(other)
    for q, found in zip(library.q, library.feature, strict=True):
        assert found == pytest.approx(feature(plain, q), abs=1e-6)
        assert plain.inside(q)


def test_the_file_of_another_robot_under_this_name_is_made_anew(
    cache: Path, robot: Robot, tmp_path: Path
) -> None:
    made = library_of(Arm(robot), COUNT)
    path = only_file(cache)
    good = path.read_bytes()
    other = changed(robot, tmp_path, lambda root: OTHERS["the tool's place"](robot, root))
    library_of(Arm(other), COUNT)
    (theirs,) = set(cache.iterdir()) - {path}
    assert theirs.stat().st_size == len(good)
    theirs.replace(path)
    assert bits(library_of(Arm(robot), COUNT)) == bits(made)
    assert path.read_bytes() == good


def test_another_size_has_another_file(cache: Path, robot: Robot) -> None:
    for count in (COUNT, COUNT + 1):
        library_of(Arm(robot), count)
    assert len(list(cache.iterdir())) == 2


def test_what_the_tool_holds_and_how_fingers_look_does_not_matter(
    cache: Path, robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = library_of(Arm(robot), COUNT)

    def change(root: ET.Element) -> None:
        for body in root.iter("body"):
            if body.get("name") in the_gripper(robot).fingers:
                body.set("pos", "0 0 0.5")

    monkeypatch.setattr(module, "_made", never)
    held = Payload(mass=2.0, inertia=(1e-2, 1e-2, 1e-2), T_tcp_com=SE3.identity())
    assert bits(library_of(Arm(robot, held), COUNT)) == bits(made)
    assert bits(library_of(Arm(changed(robot, tmp_path, change)), COUNT)) == bits(made)
    assert len(list(cache.iterdir())) == 1


@pytest.mark.parametrize("obstacle", ["a file", "a file above", "a folder in its place"])
def test_where_nothing_can_be_written_answers_are_the_same(
    cache: Path, robot: Robot, obstacle: str
) -> None:
    made = library_of(Arm(robot), COUNT)
    path = only_file(cache)
    path.unlink()
    if obstacle == "a folder in its place":
        path.mkdir()
        (path / "full").touch()
    else:
        cache.rmdir()
        blocked = cache if obstacle == "a file" else cache.parent
        if blocked == cache.parent:
            blocked.rmdir()
        blocked.write_text("in the way")
    for _ in range(2):
        assert bits(library_of(Arm(robot), COUNT)) == bits(made)
    # And nothing half written is left behind.
    if obstacle == "a folder in its place":
        assert only_file(cache) == path
    else:
        assert not cache.is_dir()


def test_a_disk_that_is_full_leaves_nothing_behind(
    cache: Path, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        made = library_of(Arm(robot), COUNT)
    assert list(cache.iterdir()) == []
    assert bits(library_of(Arm(robot), COUNT)) == bits(made)
    assert only_file(cache).stat().st_size > 0
