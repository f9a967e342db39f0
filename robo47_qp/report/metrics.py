"""Metrics of a run: tracking, time, contact, energy and smoothness."""

import numpy as np
from numpy.typing import NDArray

from robo47_qp.arrays import Matrix
from robo47_qp.constants import TIMESTEP
from robo47_qp.model.arm import bare_arm
from robo47_qp.model.robot import Robot
from robo47_qp.motion.planner import Leg
from robo47_qp.motion.tool_motion import ToolMotion, tool_motion
from robo47_qp.run.scenario import Run
from robo47_qp.run.signals import is_followed

_STILL = 1e-3
"""Peak speed below which the tool is at rest [m/s]."""


def smoothness(v: Matrix, jerk: Matrix, period: float) -> float | None:
    """Return the log dimensionless jerk [-], higher for smoother motions; None without motion.

    LDLJ = -ln(T³ / v_peak² ∫ |jerk|² dt), with T the duration and v_peak the highest speed: the
    dimensionless jerk of Hogan and Sternad (J. Motor Behavior 41(6), 2009) and its logarithm
    of Balasubramanian et al. ("On the analysis of movement smoothness", J. NeuroEngineering
    and Rehabilitation 12:112, 2015). A minimum-jerk motion has -ln(204.8) = -5.32.

    Args:
        v: Velocities (N, 3) [m/s].
        jerk: Jerks at the same instants (N, 3) [m/s³].
        period: Time between them [s].
    """
    peak = float(np.linalg.norm(v, axis=1).max(initial=0.0))
    if peak < _STILL:
        return None
    squares = float((jerk**2).sum() * period)
    return -float(np.log((len(v) * period) ** 3 / peak**2 * squares))


SETTLED = 0.1e-3
"""Distance of the tool from its goal within which it counts as settled [m]."""


FAILED_STEPS = "failed_steps"
"""The metric of a program that counts its steps that failed, whether or not it tried again."""


def metrics(run: Run) -> dict[str, float]:
    """Return the metrics of a run and the task's own figures, by name with unit.

    Errors and forces of several tools are those of the worst; rates are the main tool's.

    The recordings page of the documentation explains them. Smoothness is missing if the tool
    does not move, and all but time and the task's own figures if the run ended in its first period.
    """
    rows = run.rows
    simulated = len(rows) * TIMESTEP
    counted = {**run.measures}
    if run.failed_steps is not None:
        counted[FAILED_STEPS] = float(run.failed_steps)
    if not len(rows):
        return {**counted, "cycle_time_s": simulated}
    motion, stiff = _tool(run), _stiff(run)
    labels = [label for label, _ in run.scenario.robot.tool_labels()]
    force = np.max([np.linalg.norm(rows[f"contact/{one}tool"], axis=1) for one in labels], axis=0)
    error = np.max([rows[f"errors/{one}tool_position"] for one in labels], axis=0)[stiff]
    return {
        **counted,
        **_joint_errors(run.scenario.robot, rows["errors/q"][stiff]),
        "max_tool_error_m": float(error.max(initial=0.0)),
        "rms_tool_error_m": float(np.sqrt((error**2).mean())) if stiff.any() else 0.0,
        "settle_time_s": _settle_time(run),
        "max_tool_speed_m_s": float(np.linalg.norm(motion.v, axis=1).max(initial=0.0)),
        "max_tool_acceleration_m_s2": float(np.linalg.norm(motion.a, axis=1).max(initial=0.0)),
        **_smoothness(run, motion),
        "peak_contact_force_N": float(force.max()),
        "mean_contact_force_N": float(force[force > 0.0].mean()) if force.any() else 0.0,
        **_friction(run),
        **_following(run),
        "energy_J": _energy(run),
        "cycle_time_s": simulated,
        **({} if run.failure is not None else {"cycle_bound_s": _cycle_bound(run)}),
        "real_time_factor": simulated / run.loop_seconds,
        "step_us": 1e6 * run.loop_seconds / len(rows),
    }


def _cycle_bound(run: Run) -> float:
    """Return the least time of a run [s]: of its motions along their paths, see `Leg.lower_bound`.

    What is no planned motion, or was not driven to its end, counts with the time that it took:
    fingers, waiting, streams, motions until something is touched.
    """
    least, legs, taken, whole = 0.0, list[Leg](), 0, True
    for phase, rows in run.spans():
        if phase.leg is None:
            # Whatever was to follow without a stop was not driven.
            least += (taken + rows.stop - rows.start) * TIMESTEP
            legs, taken, whole = [], 0, True
            continue
        legs.append(phase.leg)
        taken += rows.stop - rows.start
        whole &= rows.stop - rows.start >= phase.leg.trajectory.steps
        if phase.leg.stops:
            least += sum(leg.lower_bound for leg in legs) if whole else taken * TIMESTEP
            legs, taken, whole = [], 0, True
    return least + taken * TIMESTEP


def _friction(run: Run) -> dict[str, float]:
    """Return how much of the fingers' friction was in use while something was carried [-].

    The largest share of all contacts of a finger, of which 1 less is the least slip margin, and
    the largest use of one contact; nothing for a run in which nothing was carried. See
    `FrictionUse`.
    """
    carried = np.zeros(len(run.rows), bool)
    for phase, rows in run.spans():
        carried[rows] = phase.leg is not None and phase.leg.waypoint.carried is not None
    signals = [one.name for one in run.rows.signals if one.name.endswith("friction_use")]
    used = [run.rows[name][carried] for name in signals]
    if not signals or not carried.any():
        return {}
    return {
        "max_friction_use": float(max(use[:, 1::2].max() for use in used)),
        "max_contact_friction_use": float(max(use[:, 0::2].max() for use in used)),
    }


def _following(run: Run) -> dict[str, float]:
    """Return how well a target was followed; nothing for a run without one."""
    rows = run.rows
    if not is_followed(rows.signals):
        return {}
    error = rows["target/position_error"][:, 0]
    events = rows["target/events"].any(axis=0).sum()
    return {
        "median_target_error_m": float(np.median(error)),
        "max_target_error_m": float(error.max()),
        "final_target_error_m": float(error[-1]),
        "kinds_of_target_events": float(events),
    }


def _joint_errors(robot: Robot, errors: Matrix) -> dict[str, float]:
    """Return the largest error of joints that turn and, where there are some, that slide."""
    slides = np.array(robot.units) == "m"
    turning, sliding = np.abs(errors[:, ~slides]), np.abs(errors[:, slides])
    found = {"max_joint_error_rad": float(turning.max(initial=0.0))}
    if slides.any():
        found["max_slide_error_m"] = float(sliding.max(initial=0.0))
    return found


def _stiff(run: Run) -> NDArray[np.bool_]:
    """Return True for the rows (N,) in which the arm was stiff."""
    stiff = np.ones(len(run.rows), dtype=np.bool_)
    for phase, rows in run.spans():
        stiff[rows] = not phase.compliant
    return stiff


def _tool(run: Run) -> ToolMotion:
    """Return the motion of the tool from that of the joints."""
    q, v, a = (run.rows[f"joints/{name}"] for name in "qva")
    jerk = np.diff(a, axis=0, append=a[-1:]) / TIMESTEP
    return tool_motion(bare_arm(run.scenario.robot), q, v, a, jerk)


def _smoothness(run: Run, motion: ToolMotion) -> dict[str, float]:
    """Return the mean smoothness of the motions that went from rest to rest."""
    found, start = [], None
    for phase, rows in run.spans():
        if phase.leg is None:
            start = None
            continue
        start = phase.start if start is None else start
        if phase.leg.waypoint.rests:
            whole = slice(start, rows.stop)
            value = smoothness(motion.v[whole], motion.j[whole], TIMESTEP)
            found += [] if value is None else [value]
            start = None
    return {"smoothness_ldlj": float(np.mean(found))} if found else {}


def _energy(run: Run) -> float:
    """Return the mechanical energy through the motors, both ways, Σ_i ∫ |tau_i v_i| dt [J].

    Torques are constant in a control period; velocities change linearly.
    """
    tau, v = run.rows["joints/tau"], run.rows["joints/v"]
    middle = 0.5 * (v[1:] + v[:-1])
    return float(np.abs(tau[:-1] * middle).sum() * TIMESTEP)


def _settle_time(run: Run) -> float:
    """Return the longest time from the end of a motion until the tool has settled [s].

    The tool has settled once it stays within `SETTLED` of its reference; if it does not before the
    next motion, or it gives way, presses or follows something, the time until then counts.
    """
    labels = [label for label, _ in run.scenario.robot.tool_labels()]
    error = np.max([run.rows[f"errors/{one}tool_position"][:, 0] for one in labels], axis=0)
    longest, since = 0, None
    for phase, rows in run.spans():
        if phase.compliant or phase.axis is not None or phase.streamed:
            since = None
        elif phase.leg is not None:
            since = rows.stop
        elif since is not None:
            outside = np.flatnonzero(error[rows] > SETTLED)
            settled = phase.start + int(outside[-1]) + 1 if outside.size else since
            longest = max(longest, settled - since)
    return longest * TIMESTEP
