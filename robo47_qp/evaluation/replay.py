"""Replay: runs episodes of an evaluation again and records them."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from robo47_qp.errors import RecordingError
from robo47_qp.evaluation.episode import Episode, EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.evaluation import Evaluation
from robo47_qp.evaluation.journal import Journal, JournalError
from robo47_qp.evaluation.workers.executor import Executor


def evaluated(evaluation: Evaluation, seed: int, journal: Path) -> EpisodeResult | None:
    """Return the result of a seed in a journal; None if there is none.

    Raises:
        JournalError: The journal is of another evaluation, whose worlds are others.
    """
    try:
        return Journal.read(journal, evaluation.settings).get(seed)
    except JournalError as error:
        words = str(error).replace(", or start again without --resume", "")
        raise JournalError(words.replace("settings, name", "settings, or name")) from error


def replay(
    evaluation: Evaluation,
    seed: int,
    executor: Executor,
    before: EpisodeResult | None,
    recording: Path,
) -> tuple[EpisodeResult, bool | None]:
    """Run the episode of a seed again and record it.

    Args:
        evaluation: The evaluation.
        seed: Of the episode.
        executor: Runs it.
        before: The result in the journal, if it has one.
        recording: File to write.

    Returns:
        The result, and whether it equals the one in the journal: None without that, and where
        wall time ended one of the two.

    Raises:
        RecordingError: The file cannot be written.
        WorkerError: See `Executor.run`.
    """
    index = seed - evaluation.seed if before is None else before.index
    spec = EpisodeSpec(index=index, seed=seed, recording=recording.resolve())
    (result,) = executor.run(evaluation.episode, [spec])
    return result, None if before is None else _same(before, result)


def _same(before: EpisodeResult, again: EpisodeResult) -> bool | None:
    """Return whether results are equal; None where the machine decided that one of them is late."""
    late = again.error is None and before.timed_out != again.timed_out
    return None if late else before.is_same(again)


def picked(results: Sequence[EpisodeResult], most: int) -> list[EpisodeResult]:
    """Return up to `most` failures: one of each cause, then a second of each, and so on."""
    by_cause: dict[str, list[EpisodeResult]] = {}
    for result in results:
        if not result.success and result.error is None and result.cause is not None:
            by_cause.setdefault(result.cause, []).append(result)
    ranks = [(k, r.index, r) for failures in by_cause.values() for k, r in enumerate(failures)]
    ranks.sort(key=lambda item: item[:2])
    return sorted((r for _, _, r in ranks[:most]), key=lambda r: r.index)


def record_failures(
    episode: Episode, executor: Executor, failures: Sequence[EpisodeResult], path: Path
) -> dict[int, bool | None]:
    """Run failed episodes again, recorded, and merge the recordings into one file.

    Returns:
        By seed: whether the result was identical bit by bit; None for an episode that ran out
        of wall time once and not the other time: recording takes longer, and machines are busy.

    Raises:
        RecordingError: The file cannot be written.
        WorkerError: See `Executor.run`.
    """
    same: dict[int, bool | None] = {}
    with TemporaryDirectory(dir=path.parent) as folder:
        files = {f.seed: Path(folder) / f"seed {f.seed}, {f.cause}.rrd" for f in failures}
        before = {f.seed: f for f in failures}
        specs = [EpisodeSpec(index=f.index, seed=f.seed, recording=files[f.seed]) for f in failures]
        for again in executor.run(episode, specs):
            same[again.seed] = _same(before[again.seed], again)
        _merge([file for file in files.values() if file.exists()], path)
    return dict(sorted(same.items()))


def _merge(files: Sequence[Path], path: Path) -> None:
    """Merge recordings into one file with Rerun's own tool."""
    path.unlink(missing_ok=True)
    if not files:
        return
    command = [sys.executable, "-m", "rerun", "rrd", "merge", *map(str, files), "-o", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0 or not path.exists():
        said = done.stderr.strip().splitlines()
        raise RecordingError(
            f"{path} cannot be written: the recordings of the failures could not be merged "
            f"({said[-1] if said else 'no reason given'})."
        )
