"""Worker: a process that runs one episode after the other until it is stopped."""

import gc
import json
import os
import pickle
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing import connection, get_context, parent_process
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Thread
from time import monotonic
from typing import Any

from robo47_qp._core.library import VARIABLE, backend
from robo47_qp.errors import Robo47Error
from robo47_qp.evaluation.episode import Episode, EpisodeResult, EpisodeSpec, errored
from robo47_qp.run.foreign_code import Guard, file_module, loaded_files
from robo47_qp.run.policy.child import adopt_orphans, end_children

READY = "ready"
"""Message of a worker that is ready; any other one says why it cannot start."""
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
_ALWAYS = {**dict.fromkeys(_THREADS, "1"), "MALLOC_MMAP_THRESHOLD_": str(1 << 20)}
"""Variables of workers: numerical libraries use one thread, and glibc returns large blocks at
once. Otherwise MuJoCo's arenas of 14 MB fragment the heap, which grows beyond 1 GB."""
_LONGEST = 64 << 20
"""Longest message of a worker that is read [B]."""
_UNASKED = "it sent something else than the result of its episode"
_WORDS = 20_000
"""Characters that are kept of a traceback."""
_LONGEST_WAIT = 3600.0
"""Time after which workers are looked at again, whatever their deadlines [s]."""
_GRACE = 1.0
"""Time in which a worker whose policy was ended removes what that leaves [s]."""
_ABANDONED = 3
"""Exit code of a worker whose parent has died."""


class WorkerError(Robo47Error):
    """A worker process that cannot be started."""


def run_guarded(episode: Episode, spec: EpisodeSpec) -> EpisodeResult:
    """Run an episode; an exception becomes the error of its result."""
    with Guard() as guard:
        return episode(spec)
    words = guard.words[-_WORDS:].encode("utf-8", "backslashreplace").decode("utf-8")
    return errored(spec, words)


class Worker:
    """A process and the episode that it runs."""

    def __init__(self, payload: bytes, start_timeout: float) -> None:
        """Start the process.

        Args:
            payload: The pickled episode.
            start_timeout: Time limit until it is ready [s].
        """
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        self.connection: Connection = ours
        started = theirs, payload, loaded_files()
        self._process = context.Process(target=_work, args=started, daemon=True)
        with _environment():
            self._process.start()
        theirs.close()
        self.spec: EpisodeSpec | None = None
        """The episode; None while the process starts or is idle."""
        self.ready = False
        self.deadline = monotonic() + start_timeout
        """End of its time limit, by `time.monotonic`."""

    @property
    def signs(self) -> tuple[Connection, int]:
        """What to wait for: a message, or the end of the process."""
        return self.connection, self._process.sentinel

    def begin(self, spec: EpisodeSpec, timeout: float) -> None:
        """Start an episode."""
        self.spec, self.deadline = spec, monotonic() + timeout
        # If the process is dead, `heard` reports it.
        try:
            self.connection.send_bytes(json.dumps(_packed(spec)).encode())
        except OSError:
            return

    def heard(self) -> EpisodeResult | str | None:
        """Return a result, or how the process died, or None if there is nothing new.

        Raises:
            WorkerError: The process could not start.
        """
        try:
            if not self.connection.poll():
                if self._process.is_alive():
                    return None
                # It may have sent a result between the two calls, and then died.
                if not self.connection.poll():
                    return self._death()
            said = json.loads(self.connection.recv_bytes(_LONGEST))
            result = EpisodeResult.of_entry(said["result"]) if self.ready else None
        except (EOFError, OSError):
            return self._death()
        except (ValueError, RecursionError, TypeError, KeyError):
            return _UNASKED
        if result is not None:
            # A copy of the process may speak in its place.
            spec, self.spec = self.spec, None
            asked = spec is not None and (result.index, result.seed) == (spec.index, spec.seed)
            return result if asked else _UNASKED
        if said != {"said": READY}:
            raise WorkerError(f"A worker cannot start: {said.get('said')}")
        self.ready = True
        return None

    def stop(self) -> None:
        """See `stop`."""
        stop([self])

    def end_children(self) -> bool:
        """Kill all that the process has started, on Linux; return whether there was anything."""
        pid = self._process.pid
        return pid is not None and self._process.is_alive() and end_children(pid)

    def kill(self) -> None:
        """Kill the process."""
        self._process.kill()
        self._process.join()
        self.connection.close()

    def _death(self) -> str:
        self._process.join()
        code = self._process.exitcode or 0
        how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        if not self.ready:
            raise WorkerError(f"A worker process ended with {how} before it was ready.")
        return how


def stop(workers: Sequence[Worker]) -> None:
    """Kill workers, and on Linux before them all that they have started.

    Later nothing would adopt what a policy leaves that has stopped or killed its warden. Its
    temporary files are left to the worker, which is given a second.
    """
    left = [worker for worker in workers if worker.end_children()]
    end = monotonic() + _GRACE
    for worker in left:
        worker.connection.poll(max(0.0, end - monotonic()))
    for worker in workers:
        worker.kill()


def wait_for(workers: list[Worker]) -> None:
    """Wait until one of them has a message, has died, or is out of time."""
    left = min(worker.deadline for worker in workers) - monotonic()
    signs: list[Any] = [sign for worker in workers for sign in worker.signs]
    connection.wait(signs, timeout=min(max(0.0, left), _LONGEST_WAIT))


def worker_environment() -> dict[str, str]:
    """Return the variables of workers; their backend is this process's, which reports name."""
    return {**_ALWAYS, VARIABLE: backend()}


@contextmanager
def _environment() -> Iterator[None]:
    """Start processes in the environment of workers."""
    chosen = worker_environment()
    before = {name: os.environ.get(name) for name in chosen}
    os.environ.update(chosen)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _work(link: Connection, payload: bytes, files: Sequence[Path]) -> None:
    """Run an episode for every spec that arrives, until the parent process ends.

    Args:
        link: To the parent.
        payload: The pickled episode.
        files: Files that define classes of the episode.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_parent, daemon=True).start()
    # Policies may print, but the standard output belongs to the parent, which writes JSON to it.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    sys.stdout = sys.stderr
    with Guard() as guard:
        for file in files:
            file_module(file)
        episode: Episode = pickle.loads(payload)
    if guard.error is not None:
        link.send_bytes(json.dumps({"said": guard.words}).encode())
        return
    # What is imported stays: garbage is looked for among the rest only.
    gc.freeze()
    link.send_bytes(json.dumps({"said": READY}).encode())
    adopt_orphans()
    while True:
        spec = _unpacked(json.loads(link.recv_bytes()))
        result = run_guarded(episode, spec)
        # A policy may have killed its warden.
        end_children()
        link.send_bytes(json.dumps({"result": result.entry()}).encode())


def _packed(spec: EpisodeSpec) -> dict[str, Any]:
    """Return a spec as JSON."""
    recording = None if spec.recording is None else os.fsencode(spec.recording).hex()
    return {"index": spec.index, "seed": spec.seed, "recording": recording}


def _unpacked(content: Mapping[str, Any]) -> EpisodeSpec:
    recording = content["recording"]
    path = None if recording is None else Path(os.fsdecode(bytes.fromhex(recording)))
    return EpisodeSpec(index=content["index"], seed=content["seed"], recording=path)


def _end_with_parent() -> None:
    """Exit when the parent process ends, even if it was killed."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(_ABANDONED)
