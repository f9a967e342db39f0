"""Seeds for IK: configurations of one arm with their tool poses."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import NamedTemporaryFile
from time import process_time

import mujoco
import numpy as np
from mink import SE3
from numpy.typing import NDArray
from platformdirs import user_cache_path

from robo47_qp.arrays import Matrix
from robo47_qp.ik.tool_demand import FULL, ToolDemand
from robo47_qp.model.arm import Arm
from robo47_qp.model.sampling import spread

TURN = 0.3
"""Weight of an entry of the rotation matrix beside a metre."""
_VERSION = 2
"""Of the features and the file; a library written under another one is made anew."""
_CHECKSUM = 32
"""Bytes of the checksum at the start of a file."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SeedLibrary:
    """Configurations spread evenly over the joint limits, found by their tool poses."""

    q: Matrix
    """Configurations (count, n) [rad]; joints that do not move the tool stand at home."""
    feature: NDArray[np.float32]
    """Tool position and 0.3 times the rotation matrix, per configuration (count, 12) [m]; of a
    demand the part that is asked for."""
    half_square: NDArray[np.float32]
    """Half the squared length of each feature (count,)."""

    def distances(self, target: NDArray[np.float32]) -> NDArray[np.float32]:
        """Half the squared distance of each feature to a pose's, but for one constant."""
        distances: NDArray[np.float32] = self.feature.dot(target)
        return np.subtract(self.half_square, distances, out=distances)

    def nearest(self, distances: NDArray[np.float32], count: int) -> Iterator[int]:
        """Places of the `count` least distances, least first; equal ones in their order."""
        # One by one: most searches need a few, which takes less than to sort them all.
        left = distances.copy()
        for _ in range(count):
            place = int(left.argmin())
            yield place
            left[place] = np.inf


def feature_of(pose: SE3) -> NDArray[np.float32]:
    """Return what poses are compared by (12,): position and weighted rotation matrix."""
    feature, numbers = np.empty(12), pose.wxyz_xyz
    feature[:3] = numbers[4:]
    mujoco.mju_quat2Mat(feature[3:], numbers[:4])
    feature[3:] *= TURN
    return feature.astype(np.float32)


def library_of(arm: Arm, count: int, tool: int = 0, demand: ToolDemand = FULL) -> SeedLibrary:
    """The library of a tool of an arm: from memory, from the user's cache folder, or made now.

    Its features hold what a demand asks for; compare them with `demand.feature(feature_of(pose))`.

    What is kept on disk is named after what forward kinematics depends on: another robot,
    tool frame or joint limit has another name. A file that cannot be read, or is not to the
    bit what was written, is made anew, and one that cannot be written is made anew in the
    next process: neither changes an answer.
    """
    if demand == FULL:
        return arm.derived(_library, count, tool)
    return arm.derived(_demanded, count, tool, demand)


def build_seconds(arm: Arm, count: int = 3000, tool: int = 0) -> float:
    """Return the processor time that it takes to make a library, read from nowhere [s]."""
    started = process_time()
    _by_feature(*_made(arm, count, tool))
    return process_time() - started


def _demanded(arm: Arm, count: int, tool: int, demand: ToolDemand) -> SeedLibrary:
    library = library_of(arm, count, tool)
    return _by_feature(library.q, demand.feature(library.feature))


def _library(arm: Arm, count: int, tool: int) -> SeedLibrary:
    path = user_cache_path("robo47_qp") / f"ik-{_digest(arm, count, tool)}.bin"
    kept = _read(path, arm, count)
    if kept is None:
        kept = _made(arm, count, tool)
        _write(path, *kept)
    return _by_feature(*kept)


def _by_feature(q: Matrix, feature: NDArray[np.float32]) -> SeedLibrary:
    half_square = 0.5 * np.einsum("ij,ij->i", feature, feature)
    for array in (q, feature, half_square):
        array.setflags(write=False)
    return SeedLibrary(q=q, feature=feature, half_square=half_square)


def _made(arm: Arm, count: int, tool: int) -> tuple[Matrix, NDArray[np.float32]]:
    joints = arm.tool_joints(tool)
    q = np.tile(arm.home, (count, 1))
    q[:, joints] = spread(arm.q_low[joints], arm.q_high[joints], count)
    feature = np.empty((count, 12), dtype=np.float32)
    for row, configuration in zip(feature, q, strict=True):
        row[:] = feature_of(arm.pose(configuration, tool))
    return q, feature


def _digest(arm: Arm, count: int, tool: int) -> str:
    m, site = arm.model, arm.model.site(arm.tool_sites[tool])
    # From the tool to the world: neither what it holds nor what hangs on other bodies moves it.
    bodies = [int(site.bodyid[0])]
    while bodies[-1] > 0:
        bodies.append(int(m.body_parentid[bodies[-1]]))
    chain: list[NDArray[np.generic]] = [
        *(m.body_pos[bodies], m.body_quat[bodies], m.body_jntadr[bodies], m.body_jntnum[bodies]),
        *(m.jnt_type, m.jnt_pos, m.jnt_axis, m.jnt_range, m.qpos0),
        *(site.pos, site.quat),
        # What stands at home there.
        arm.home[~arm.tool_joints(tool)],
    ]
    digest = sha256(f"{_VERSION} {count} {TURN} {mujoco.__version__} {np.__version__}".encode())
    for array in chain:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def _checksum(path: Path, kept: bytes) -> bytes:
    """Of what is kept and of its name: a file that was renamed is another robot's."""
    return sha256(path.name.encode() + kept).digest()


def _read(path: Path, arm: Arm, count: int) -> tuple[Matrix, NDArray[np.float32]] | None:
    """What `_write` left there; None where it is not that to the bit."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    checksum, kept = data[:_CHECKSUM], data[_CHECKSUM:]
    ends = 8 * count * arm.n
    if len(kept) != ends + 4 * count * 12 or checksum != _checksum(path, kept):
        return None
    q = np.frombuffer(kept[:ends], dtype=np.float64).reshape(count, arm.n).copy()
    feature = np.frombuffer(kept[ends:], dtype=np.float32).reshape(count, 12).copy()
    return q, feature


def _write(path: Path, q: Matrix, feature: NDArray[np.float32]) -> None:
    kept = q.tobytes() + feature.tobytes()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Under another name first: two processes may write at once.
        with NamedTemporaryFile(dir=path.parent, suffix=".tmp", delete=False) as file:
            part = Path(file.name)
    except OSError:
        return
    try:
        part.write_bytes(_checksum(path, kept) + kept)
        part.replace(path)
    except OSError:
        with suppress(OSError):
            part.unlink()
