"""Recordings read back: the signals, phases and notes of a Rerun file."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from robo47_qp.arrays import Vector
from robo47_qp.errors import RecordingError
from robo47_qp.report.rerun.blueprint import EVENTS, PHASES, SIGNALS, SUMMARY
from robo47_qp.report.rerun.columns import component
from robo47_qp.report.rerun.stream import TIMELINE
from robo47_qp.run.recording import Rows
from robo47_qp.sim.signal import Signal


@dataclass(frozen=True, kw_only=True)
class Note:
    """A line of the events."""

    time: float
    """[s]"""
    level: str
    """INFO, WARN or ERROR."""
    text: str


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedRun:
    """A run as its recording has it."""

    rows: Rows
    """Every recorded signal by name, with labels and units: `rows["joints/q"]` is (N, joints) and
    `rows["time"]` is (N, 1) [s]."""
    phases: Sequence[tuple[float, str]]
    """Start [s] and name of each phase."""
    notes: Sequence[Note]
    summary: str | None
    """The report in Markdown; None for a run that was interrupted."""


def read_recording(path: Path) -> RecordedRun:
    """Read a recording of one run.

    Raises:
        RecordingError: There is no such file, it is not the recording of a run, or it is damaged
            or holds several runs.
    """
    runs = read_recordings(path)
    if len(runs) != 1:
        raise RecordingError(f"{path} holds {len(runs)} runs; read them with read_recordings.")
    return runs[0]


def read_recordings(path: Path) -> list[RecordedRun]:
    """Read all runs of a file, such as the recorded failures of an evaluation.

    Raises:
        RecordingError: There is no such file, it is not a recording of runs, or it is damaged.
    """
    if not path.is_file():
        raise RecordingError(f"{path} cannot be read: there is no such file.")
    try:
        with warnings.catch_warnings():
            # The file of a killed process has no footer; it is read from its start.
            warnings.simplefilter("ignore", RerunWarning)
            reader = RrdReader(path)
            recordings = [reader.stream(store=store).to_chunks() for store in reader.recordings()]
    except (RuntimeError, ValueError) as error:
        raise RecordingError(
            f"{path} cannot be read: it is not a Rerun recording, or it is damaged ({error}). If "
            f"its end is missing, try: rerun rrd optimize {path} -o repaired.rrd"
        ) from error
    return [_run(path, chunks) for chunks in recordings]


def _run(path: Path, chunks: Sequence[Chunk]) -> RecordedRun:
    found: dict[str, list[Any]] = {f"/{e}": [] for e in (SIGNALS, PHASES, EVENTS, SUMMARY)}
    for chunk in chunks:
        if (entity := str(chunk.entity_path)) in found:
            found[entity].append(chunk.to_record_batch())
    signals, phases, events, summary = found.values()
    texts = _listed(summary, "TextDocument:text")
    starts = zip(_times(phases).tolist(), _listed(phases, "StateChange:state"), strict=True)
    levels, lines = (_listed(events, f"TextLog:{name}") for name in ("level", "text"))
    told = zip(_times(events).tolist(), levels, lines, strict=True)
    # Rerun's own tools may change the order of chunks.
    return RecordedRun(
        rows=_rows(path, signals),
        phases=sorted(starts, key=itemgetter(0)),
        notes=[Note(time=t, level=s, text=line) for t, s, line in sorted(told, key=itemgetter(0))],
        summary=texts[0] if texts else None,
    )


def _rows(path: Path, batches: Sequence[Any]) -> Rows:
    described = {
        name: batch.column(name).to_pylist()[0]
        for batch in batches
        for name in batch.schema.names
        if name.startswith(("labels:", "units:"))
    }
    chunks = [batch for batch in batches if TIMELINE in batch.schema.names]
    if not described or not chunks:
        raise RecordingError(f"{path} cannot be read: it does not hold the signals of a run.")
    signals = [Signal(name="time", labels=("t",), unit="s")]
    columns = [_times(chunks)[:, None]]
    for name, labels in described.items():
        kind, _, signal = name.partition(":")
        held = signal != TIMELINE and component(signal) in chunks[0].schema.names
        if kind == "labels" and held:
            unit = described[f"units:{signal}"][0]
            signals.append(Signal(name=signal, labels=tuple(labels), unit=unit))
            parts = [chunk.column(component(signal)).flatten().to_numpy() for chunk in chunks]
            columns.append(np.concatenate(parts).reshape(-1, len(labels)))
    order = np.argsort(columns[0][:, 0], kind="stable")
    return Rows(signals, np.hstack(columns)[order])


def _times(batches: Sequence[Any]) -> Vector:
    """Return the instants of all rows (N,) [s]."""
    columns = [batch.column(TIMELINE).to_numpy(zero_copy_only=False) for batch in batches]
    instants = np.concatenate(columns) if columns else np.empty(0, "timedelta64[ns]")
    times: Vector = instants.astype("timedelta64[ns]").astype(np.int64) / 1e9
    return times


def _listed(batches: Sequence[Any], name: str) -> list[str]:
    """Return the texts of a column, one of each row."""
    return [text for batch in batches for (text,) in batch.column(name).to_pylist()]
