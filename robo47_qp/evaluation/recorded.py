"""An episode with a recording to look at."""

from pathlib import Path

from robo47_qp import signals
from robo47_qp.audit import audit
from robo47_qp.evaluation.task_episode import Drive
from robo47_qp.metrics import metrics
from robo47_qp.report import report, summary_markdown
from robo47_qp.rerun_log import RerunLog
from robo47_qp.run import Run, Scenario
from robo47_qp.simulation import Simulation


def recorded(drive: Drive, scenario: Scenario, simulation: Simulation, path: Path) -> Run:
    """Drive an episode and record it.

    Raises:
        RecordingError: The recording cannot be written.
        Robo47Error: See `Drive`; what was recorded up to there is kept.
    """
    columns = signals.all_signals(scenario.robot, simulation.objects)
    log = RerunLog(path, simulation.model, scenario.robot, columns)
    try:
        run = drive(scenario, simulation, sinks=[log], observers=[log])
        log.finish(summary_markdown(report(run, metrics(run), audit(run))))
    finally:
        log.close()
    return run
