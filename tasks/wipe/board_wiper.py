"""BoardWiper: the steps that move a sponge over a board."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Any

import numpy as np
from mink import SE3

from robo47_qp.motion.waypoint import Motion, Waypoint, tool_down
from robo47_qp.run.contact_steps import Press
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.steps import Move, StepLike
from robo47_qp.sim.sensed import Sensed
from robo47_qp.tasks.handling.item_handler import ItemHandler
from robo47_qp.tasks.handling.wrist import FreeWrist, read_free_wrist, wrist_errs
from robo47_qp.tasks.heading import heading
from robo47_qp.tasks.wipe.board import SURFACE, WipeSettings

_STROKE, _LANES = 0.09, (-0.04, 0.0, 0.04)
"""Half the length of a stroke along the board's y, and the positions of the strokes along its x
[m]."""
_ABOVE = 0.015
"""Height of the sponge above the nominal surface before it is lowered [m]."""
_SETTLED, _READ = 0.5, 0.2
"""Time from contact until the force has settled, and in which it is then measured [s]."""
_SWIFTLY, _GENTLY = 0.7, 0.5
"""Speed without contact of a sponge that is lowered, relative to the largest: where the force is
measured exactly, and where touches have to be even [-]."""
_DAMPED = 20.0
"""Damping of the sponge on the board, relative to its apparent mass: 0.8 to 1 of the critical one
[1/s]."""
_FIRST_TOUCHES, _TOUCHES, _BETWEEN = 6, 4, 0.017
"""Touches before the first stroke and before each other one, where the wrist errs, and by how much
the tool rises between two, more than the foam gives way [m]."""
_FOAM = 1100.0
"""Stiffness of the foam [N/m]."""
_TOUCH_ERROR = 0.15e-3
"""Standard deviation of the height that a touch tells [m]."""
_CREEP = (4.5e-5, 1e-5)
"""Mean and standard deviation of the rate at which the sponge creeps between the fingers [m/s]."""
_CAREFUL, _DRAGGED = 0.025, 5e-5
"""Speed of the sponge that is wiped by the foam [m/s], and by how much foam that is dragged so
slowly rises at the same force [m]."""
_EASED, _EASY, _OFF = 0.014, 3e-3, 0.02
"""Way [m] and speed [m/s] at which a sponge that has slid is relieved, as it slips back if that is
fast, and the speed at which it is lifted off otherwise [m/s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardWiper(ItemHandler):
    """Picks the sponge, wipes the board with it and puts it back."""

    settings: WipeSettings
    T_world_board: SE3
    """Estimated pose of the board, but for its height."""

    def wipe(self) -> Generator[StepLike, None, None]:
        """Lower the sponge to the board, wipe and lift it; fails with DROP or TIMEOUT."""
        held = (self._held(Cause.DROP),)
        yield Move(waypoints=self.to_board(), before=held, during=held)
        if wrist_errs(self.sensed):
            yield from self._wipe_by_foam()
        else:
            yield from self._touch_down(self._force)
            # Level, at the height at which the tool is now.
            strokes = self.strokes(self.sensed.tool_pose().translation()[2])
            speed = self.settings.speed
            yield self._press("wipe", self._force, waypoints=strokes, speed=speed)
            yield self._rise("lift off", _BETWEEN, _OFF)
        yield self._line("leave the board", self._up(self.sensed.tool_pose()))

    def _wipe_by_foam(self) -> Generator[StepLike, None, None]:
        """Wipe with the foam as the sensor of the force: a spring, which does not drift.

        Before each stroke, short touches tell how high the tool is when the sensor at the wrist
        feels what is asked for, each with the readings of the free wrist before and after it.
        """
        foam = FoamSpring(force=self.settings.force)
        for i, x in enumerate(_LANES):
            if i:
                height = self.sensed.tool_pose().translation()[2]
                beside = self._over(x, -_STROKE, height)
                yield Move(waypoints=(self._line(f"to stroke {i + 1}", beside),))
            free = yield from read_free_wrist(self.sensed)
            for _ in range(_TOUCHES if i else _FIRST_TOUCHES):
                touch = yield from self._touch_down(partial(self._force_from, free.force))
                yield self._rise("lift off", _BETWEEN, _OFF)
                after = yield from read_free_wrist(self.sensed)
                foam.add(touch, free, after)
                free = after
            touch = yield from self._touch_down(partial(self._force_from, free.force))
            end = self._over(x, _STROKE, self.sensed.tool_pose().translation()[2])
            stroke = self._line(f"stroke {i + 1}", end)
            felt = partial(foam.force_at, self.sensed, touch)
            yield self._press("settle", felt, seconds=_SETTLED)
            yield self._press("wipe", felt, waypoints=(stroke,), speed=_CAREFUL)
            foam.pressed += self.sensed.time - touch.since
            yield self._press("stop", felt, seconds=_SETTLED)
            yield self._rise("ease", _EASED, _EASY)
            yield self._rise("lift off", _BETWEEN - _EASED, _OFF)

    def _touch_down(self, felt: Callable[[], float]) -> Generator[StepLike, None, "Touch"]:
        """Lower the sponge until it is pressed as asked, by what tells its force [N]."""
        touch = Touch(self.sensed, felt, 0.5 * self.settings.force)
        yield self._press(
            "touch down", felt, seconds=3.0, until=self._pressed(touch), observe=touch.read
        )
        return touch

    def _press(self, name: str, felt: Callable[[], float], **more: Any) -> Press:
        share = _GENTLY if wrist_errs(self.sensed) else _SWIFTLY
        damping = self.settings.force / (share * self.settings.touch_speed)
        return Press(
            name=name,
            axis=np.array([0.0, 0.0, -1.0]),
            force=self.settings.force,
            felt=felt,
            mass=damping / _DAMPED,
            damping=damping,
            during=(self._held(Cause.DROP),),
            **more,
        )

    def _rise(self, name: str, way: float, speed: float) -> Press:
        """Return the step straight up by a way [m] at a speed [m/s], with the arm stiff."""
        x, y, z = (T := self.sensed.tool_pose()).translation()
        up = SE3.from_rotation_and_translation(T.rotation(), np.array([x, y, z + way]))
        step = self._press(name, self._force, waypoints=(self._line(name, up),), speed=speed)
        return replace(step, force=0.0)

    def to_board(self) -> tuple[Waypoint, Waypoint]:
        """Return the waypoints above the first stroke, and down to a little above the board."""
        height = self._let_down()
        strokes, start = self.strokes(height), self._over(_LANES[0], -_STROKE, height)
        payload = self.item.payload(SE3.identity())
        hover = Waypoint(name="hover", target=start, motion=Motion.LIN, carried=payload)
        above = self._up(start)
        onward = (hover, *strokes)
        return Waypoint(name="to the board", target=above, carried=payload, onward=onward), hover

    def _let_down(self) -> float:
        """Return the height of the tool from which the sponge is lowered [m]."""
        return SURFACE + 0.5 * self.item.height + _ABOVE

    def strokes(self, height: float) -> tuple[Waypoint, ...]:
        """Return the strokes up and down the board at a height of the tool, without stops [m]."""
        ways, end = [], _STROKE
        for i, x in enumerate(_LANES):
            if i:
                centre = self._over(0.5 * (x + _LANES[i - 1]), -end, height)
                middle = centre.translation() - np.sign(end) * 0.5 * (x - _LANES[i - 1]) * self._y()
                ways.append(
                    Waypoint(
                        name=f"turn {i}",
                        target=self._over(x, -end, height),
                        motion=Motion.CIRC,
                        through=middle,
                        blend=0.01,
                    )
                )
            last = i == len(_LANES) - 1
            ways.append(
                Waypoint(
                    name=f"stroke {i + 1}",
                    target=self._over(x, end, height),
                    motion=Motion.LIN,
                    blend=0.0 if last else 0.01,
                )
            )
            end = -end
        return tuple(ways)

    def _over(self, x: float, y: float, height: float) -> SE3:
        """Return the tool pose over a position on the board, at a height in the world [m]."""
        at = self.T_world_board @ np.array([x, y, 0.0])
        at[2] = height
        return tool_down(at, heading(self.T_world_board))

    def _y(self) -> np.ndarray:
        """Return the direction of the strokes (3,) [-]."""
        return self.T_world_board.rotation().as_matrix()[:, 1]

    def _force(self) -> float:
        """Return the force of the sponge on the board, as measured without its weight [N]."""
        return float(self.sensed.felt_force()[2]) + 9.81 * self.item.mass

    def _force_from(self, free: np.ndarray) -> float:
        """Return the same from what the free wrist read (3,) [N]."""
        return float(self.sensed.felt_force()[2] - free[2])

    def _pressed(self, touch: "Touch") -> Condition:
        """Return the condition that the sponge has been pressed for long enough to settle."""

        def against() -> str | None:
            if touch.done:
                return None
            return (
                f"the sponge presses with {touch.felt():.2f} N, "
                f"{self.settings.force:.2f} N are asked for"
            )

        return Condition(name="the sponge is on the board", cause=Cause.TIMEOUT, against=against)


class Touch:
    """A touch of the board, as it is measured."""

    def __init__(self, sensed: Sensed, felt: Callable[[], float], contact: float) -> None:
        """Begin before it.

        Args:
            sensed: What is sensed.
            felt: Returns the force of the sponge [N].
            contact: Force that counts as contact [N].
        """
        self.felt = felt
        self.since = inf
        """When contact began [s]."""
        self._sensed, self._contact = sensed, contact
        self._readings: list[tuple[float, float, float]] = []

    def read(self) -> None:
        """Measure time, height of the tool and force."""
        time, force = self._sensed.time, self.felt()
        if self.since == inf and force >= self._contact:
            self.since = time
        if time >= self.since + _SETTLED:
            height = float(self._sensed.tool_pose().translation()[2])
            self._readings.append((time, height, force))

    @property
    def done(self) -> bool:
        """Whether the force has settled, and was measured for long enough."""
        return len(self._readings) > 1 and self._readings[-1][0] - self._readings[0][0] >= _READ

    @property
    def mean(self) -> tuple[float, float, float]:
        """Mean time [s], height of the tool [m] and force [N] after it had settled."""
        time, height, force = np.mean(self._readings, axis=0).tolist()
        return time, height, force


class FoamSpring:
    """The foam as a sensor of the force: what the force is at a height of the tool.

    The height with the force that is asked for is h - c t: as it is pressed, the sponge creeps
    between the fingers, t the time in contact so far. Both are estimated by least squares from
    touches, with what creep is usual.
    """

    def __init__(self, force: float) -> None:
        """Start without touches; `force` is what is asked for [N]."""
        self.force, self.pressed = force, 0.0
        weight = _TOUCH_ERROR / _CREEP[1]
        self._rows, self._values = [[0.0, weight]], [weight * _CREEP[0]]

    def add(self, touch: Touch, before: FreeWrist, after: FreeWrist) -> None:
        """Take in a touch between two readings of the free wrist, whose drift is taken off."""
        time, height, force = touch.mean
        share = (time - before.time) / (after.time - before.time)
        force -= share * float(after.force[2] - before.force[2])
        self._rows.append([1.0, -(self.pressed + time - touch.since)])
        self._values.append(height + (force - self.force) / _FOAM)
        self.pressed += _SETTLED + _READ

    def force_at(self, sensed: Sensed, touch: Touch) -> float:
        """Return the force while the sponge is dragged over the board after a touch [N]."""
        height, creep = np.linalg.lstsq(self._rows, self._values, rcond=None)[0].tolist()
        pressed = self.pressed + sensed.time - touch.since
        off = height - creep * pressed + _DRAGGED - float(sensed.tool_pose().translation()[2])
        return float(self.force + _FOAM * off)
