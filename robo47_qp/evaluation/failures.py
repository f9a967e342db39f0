"""One recording with the failures of an evaluation, ready to look at."""

import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from robo47_qp.errors import RecordingError
from robo47_qp.evaluation.episode import Episode, EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.workers.executor import Executor


def picked(results: Sequence[EpisodeResult], most: int) -> list[EpisodeResult]:
    """At most so many failures: one of each cause, then one more of each, and so on."""
    by_cause: dict[str, list[EpisodeResult]] = {}
    for result in results:
        if not result.success and result.error is None and result.cause is not None:
            by_cause.setdefault(result.cause, []).append(result)
    ranks = [(k, r.index, r) for failures in by_cause.values() for k, r in enumerate(failures)]
    ranks.sort(key=lambda item: item[:2])
    return sorted((r for _, _, r in ranks[:most]), key=lambda r: r.index)


def record_failures(
    episode: Episode, executor: Executor, failures: Sequence[EpisodeResult], path: Path
) -> Mapping[int, bool | None]:
    """Run failed episodes again and write one file with a recording of each.

    Returns:
        By seed: whether the episode came out the same, bit by bit; None where it was not over in
        time, as recording takes longer.

    Raises:
        RecordingError: The file cannot be written.
        WorkerError: See `Executor.run`.
    """
    same: dict[int, bool | None] = {}
    with TemporaryDirectory(dir=path.parent) as folder:
        specs = {
            f.seed: EpisodeSpec(
                index=f.index,
                seed=f.seed,
                recording=Path(folder) / f"seed {f.seed}, {f.cause}.rrd",
            )
            for f in failures
        }
        before = {f.seed: f for f in failures}
        for again in executor.run(episode, list(specs.values())):
            first = before[again.seed]
            late = again.timed_out and not first.timed_out
            same[again.seed] = None if late else is_same(first, again)
        files = [spec.recording for spec in specs.values() if spec.recording is not None]
        _merge([file for file in files if file.exists()], path)
    return dict(sorted(same.items()))


def is_same(a: EpisodeResult, b: EpisodeResult) -> bool:
    """True where two results differ in nothing but wall time."""
    return replace(a, timing={}) == replace(b, timing={})


def _merge(files: Sequence[Path], path: Path) -> None:
    """One file with several recordings, by Rerun's own tool."""
    path.unlink(missing_ok=True)
    if not files:
        return
    command = [sys.executable, "-m", "rerun", "rrd", "merge", *map(str, files), "-o", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0 or not path.exists():
        said = done.stderr.strip().splitlines()
        raise RecordingError(
            f"{path} cannot be written: the recordings of the failures could not be put "
            f"together ({said[-1] if said else 'no reason told'})."
        )
