"""What a step of the control loop costs, beside bare mj_step, all measured in one run.

Writes logs/step_cost.json with the medians in microseconds: mj_step_us, loop_us, controller_us,
recording_us, cartesian_us, and the backend that was measured. Controllers are asked as the loop
asks them: many periods at once where they are in the compiled core. A decision of a policy is
measured in a process of its own, as in evaluations, and in this process.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter

from robo47_qp.report.importing import importing

with importing():
    import mujoco
    import numpy as np
    from rich.console import Console

    from robo47_qp._core.library import backend
    from robo47_qp.cli import LOGS, main
    from robo47_qp.constants import TIMESTEP
    from robo47_qp.control.active import ActiveController
    from robo47_qp.control.cartesian_impedance import CartesianImpedance
    from robo47_qp.control.controller import Controller
    from robo47_qp.control.joint_impedance import JointImpedance
    from robo47_qp.control.observer import DisturbanceObserver
    from robo47_qp.control.operational_space import OperationalSpace
    from robo47_qp.errors import InvalidValueError
    from robo47_qp.files import write_json
    from robo47_qp.model.arm import Arm, JointReference, JointState
    from robo47_qp.model.gripper import Grip
    from robo47_qp.model.robots.panda import PANDA
    from robo47_qp.report.figures_table import FiguresTable
    from robo47_qp.report.progress import Steps
    from robo47_qp.report.provenance import provenance
    from robo47_qp.report.rerun.log import RerunLog
    from robo47_qp.run import signals
    from robo47_qp.run.policy.cell import PolicyCell
    from robo47_qp.run.policy.policy import Policy
    from robo47_qp.run.policy.process import PolicyProcess
    from robo47_qp.run.recording import Rows
    from robo47_qp.run.row_file import RowFile
    from robo47_qp.run.runner import Runner
    from robo47_qp.run.scenario import Run
    from robo47_qp.sim.simulation import Simulation
    from robo47_qp.stack import ClassicalStack
    from robo47_qp.tasks.pick_place.pick_place import PickPlace
    from robo47_qp.tasks.reach.reach import Reach
    from scenarios.policies.hold_poses import HoldPoses

_DECISIONS = 500
"""Decisions of a policy in a round."""
REPORT = LOGS / "step_cost.json"


@dataclass(frozen=True, kw_only=True)
class StepCostOptions:
    """Options of this scenario."""

    rounds: int = 5
    """How often everything is measured, in turn; the medians are shown."""

    def __post_init__(self) -> None:
        """Check what no type can.

        Raises:
            InvalidValueError: There is nothing to measure.
        """
        if self.rounds < 1:
            raise InvalidValueError("--rounds", self.rounds, "1 or more")


class TimedLog:
    """A sink that times another one."""

    def __init__(self, log: RerunLog) -> None:
        self._log = log
        self.seconds = 0.0

    def write(self, rows: Rows) -> None:
        started = perf_counter()
        self._log.write(rows)
        self.seconds += perf_counter() - started


def run(options: StepCostOptions, console: Console) -> int:
    """Measure and print; returns the exit code."""
    task = PickPlace()
    scenario = ClassicalStack().scenario(PANDA, task)
    costs: dict[str, list[float]] = {}
    decided, crossed = list[float](), list[float]()
    numbers, made = 0, provenance()
    with Steps(console, options.rounds, "rounds", timed=True) as told:
        for _ in told.over(range(options.rounds)):
            with TemporaryDirectory() as folder:
                simulation = Simulation(PANDA, task.build_scene)
                runner = Runner(scenario, simulation)
                described = simulation.model, PANDA, runner.signals
                log = RerunLog(Path(folder) / "run.rrd", *described)
                rows = RowFile(Path(folder) / "run.rows", *described)
                timed = TimedLog(log)
                done = runner.run(sinks=[timed], store=rows)
                log.close()
                rows.close()
            steps, numbers = len(done.rows), done.rows.values.shape[1]
            for name, seconds in {
                "bare mj_step, same torques": _replay(done),
                "controller": _control(done, done.scenario.controller, done.scenario.observer),
                "controller without its observer": _control(done, done.scenario.controller),
                "joint impedance instead": _control(done, JointImpedance(), done.scenario.observer),
                "Cartesian impedance instead": _control(
                    done, CartesianImpedance(), done.scenario.observer
                ),
                "operational space instead": _control(
                    done, OperationalSpace(), done.scenario.observer
                ),
                "recording: columns": _columns(done),
                "recording: Rerun file": timed.seconds,
                "whole loop": done.loop_seconds,
            }.items():
                costs.setdefault(name, []).append(1e6 * seconds / steps)
            decided.append(_decisions(HoldPoses()))
            crossed.append(_crossed())
    table = FiguresTable(("part of a step", "µs"), texts=("part of a step",))
    for name, values in costs.items():
        table.add_row(name, f"{median(values):.1f}")
    console.print(table)
    own, alone = 1e6 * median(crossed), median(costs["controller without its observer"])
    controller = median(costs["controller"])
    step, loop = median(costs["bare mj_step, same torques"]), median(costs["whole loop"])
    cartesian = median(costs["Cartesian impedance instead"])
    report = {
        "backend": backend(),
        "rounds": options.rounds,
        "mj_step_us": step,
        "loop_us": loop,
        "controller_us": controller,
        "controller_over_without_observer": controller / alone,
        "decision_us": 1e6 * median(decided),
        "decision_own_process_us": own,
        "recording_us": median(costs["recording: Rerun file"]),
        "cartesian_us": cartesian,
        "loop_over_mj_step": loop / step,
        "cartesian_over_mj_step": cartesian / step,
        "all_us": {name: median(values) for name, values in costs.items()},
    }
    write_json(REPORT, {**made, **report})
    console.print(f"backend {backend()}; the loop takes {loop / step:.2f} of mj_step; {REPORT}")
    console.print(f"Cartesian impedance with the observer takes {cartesian / step:.2f} of mj_step")
    console.print(f"the observer makes the controller take {controller / alone:.2f} times as long")
    console.print(f"a decision of a policy in a process of its own takes {own:.0f} µs")
    factor = 1e3 / loop
    console.print(f"{numbers} numbers per step; {factor:.0f} times real time", highlight=False)
    return 0


def _replay(done: Run) -> float:
    """Seconds that mj_step alone takes for the torques and grips of a run."""
    task = PickPlace()
    simulation = Simulation(PANDA, task.build_scene)
    task.reset(simulation, None)
    simulation.command_grip(Grip(width=simulation.gripper_of().width_max, force=task.grip_force))
    m, d = simulation.model, simulation.data
    controls = np.hstack([done.rows["joints/tau"], done.rows["gripper/width_command"]])
    started = perf_counter()
    for ctrl in controls:
        d.ctrl[:] = ctrl
        mujoco.mj_step(m, d)
    return perf_counter() - started


def _control(
    done: Run, controller: Controller, observer: DisturbanceObserver | None = None
) -> float:
    """Seconds that a controller within its limits takes for the states of a run."""
    arm, rows = Arm(PANDA), done.rows
    active = ActiveController(controller, arm, dt=TIMESTEP, observer=observer)
    names = ("joints/q_ref", "joints/v_ref", "joints/a_ref", "joints/q", "joints/v")
    columns = [rows[name] for name in names]
    started, done_rows = perf_counter(), 0
    while done_rows < len(rows):
        q_ref, v_ref, a_ref, q, v = (column[done_rows:] for column in columns)
        compiled = active.compiled
        if compiled is None:
            active.torque(JointReference(q_ref[0], v_ref[0], a_ref[0]), JointState(q[0], v[0]))
            done_rows += 1
            continue
        part = slice(min(active.enter(compiled, q[0]), len(q)))
        references = active.sampled(JointReference(q_ref[part], v_ref[part], a_ref[part]))
        compiled.torques(references, JointState(q[part], v[part]))
        active.leave(compiled, len(references.q))
        done_rows += len(references.q)
    return perf_counter() - started


def _decisions(policy: Policy) -> float:
    """Seconds that a decision of a policy takes."""
    task = Reach()
    scenario = ClassicalStack().scenario(PANDA, task)
    cell = PolicyCell(Runner(scenario, Simulation(PANDA, task.build_scene)).loop)
    policy.reset(cell.observe())
    observation = cell.observe()
    started = perf_counter()
    for _ in range(_DECISIONS):
        policy.act(observation)
    return (perf_counter() - started) / _DECISIONS


def _crossed() -> float:
    """Seconds that a decision takes in a process of its own."""
    path = Path(__file__).parent / "policies" / "hold_poses.py"
    policy = PolicyProcess(f"{path}:HoldPoses")
    try:
        policy.start(0)
        return _decisions(policy)
    finally:
        policy.close()


def _columns(done: Run) -> float:
    """Seconds that filling the columns of a run takes."""
    simulation = Simulation(PANDA, PickPlace().build_scene)
    now = sum(len(signal.labels) for signal in simulation.signals_now)
    last = sum(len(signal.labels) for signal in simulation.signals_last)
    rows = Rows(done.rows.signals, done.rows.values.copy())
    row_now, row_last = np.empty(now), np.empty(last)
    started = perf_counter()
    for _ in range(len(rows)):
        simulation.write_now(row_now)
        simulation.write_last(row_last)
    for first in range(0, len(rows), 400):
        block = Rows(rows.signals, rows.values[first : first + 400])
        signals.derive(block, PANDA)
    return perf_counter() - started


if __name__ == "__main__":
    sys.exit(main(StepCostOptions, run, __doc__))
