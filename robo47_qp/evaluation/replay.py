"""Replay: one episode of an evaluation again, recorded, in a process as all others."""

import json
import sys

from rich.console import Console
from rich.markup import escape

from robo47_qp.cli import FAILED, OK
from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.failures import is_same
from robo47_qp.evaluation.job import Job, write_json
from robo47_qp.evaluation.journal import Journal, JournalError
from robo47_qp.evaluation.workers.executor import LocalProcesses
from robo47_qp.files import claim


def replay(job: Job, seed: int, console: Console) -> int:
    """Run the episode of a seed; returns the exit code.

    Raises:
        Robo47Error: Bad input, or a file that cannot be written.
    """
    options = job.options
    path = options.log.with_name(f"{options.log.stem}-{job.task.name}-{seed}.rrd")
    report = path.with_suffix(".json")
    for file in (path, report):
        claim(file)
    before = _journalled(job, seed)
    executor = LocalProcesses(workers=1, timeout=options.timeout)
    index = seed - options.seed if before is None else before.index
    spec = EpisodeSpec(index=index, seed=seed, recording=path.resolve())
    (result,) = executor.run(job.evaluation.episode, [spec])
    same = None if before is None else is_same(before, result)
    entry = {**result.entry(), "same_as_evaluated": same}
    write_json(entry, report)
    if options.json:
        sys.stdout.write(json.dumps(entry, indent=2) + "\n")
    else:
        words = "success" if result.success else f"{result.failure}: {result.evidence}"
        console.print(f"seed {seed}: {escape(words)}", highlight=False)
        if result.error is not None:
            console.print(escape(result.error), highlight=False)
        if same is not None:
            console.print(f"  as in the evaluation, bit by bit: {'yes' if same else 'NO'}")
        console.print(f"  recording  {path}", highlight=False, soft_wrap=True)
    return FAILED if result.error is not None or same is False else OK


def _journalled(job: Job, seed: int) -> EpisodeResult | None:
    """What the evaluation with these settings, if there is one, says of an episode."""
    try:
        return Journal.read(job.options.files["journal"], job.evaluation.settings).get(seed)
    except JournalError:
        return None
