"""BoardWiper: the steps that move a sponge over a board."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Any, Self

import numpy as np
from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.motion.waypoint import Motion, Waypoint, tool_down
from robo47_qp.run.contact_steps import Press
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.steps import Grasp, Move, StepLike
from robo47_qp.sim.sensed import Sensed
from robo47_qp.tasks.handling.item_handler import ItemHandler
from robo47_qp.tasks.handling.pose_estimate import camera_errs
from robo47_qp.tasks.handling.wrist import FreeWrist, read_free_wrist, wrist_errs
from robo47_qp.tasks.heading import heading
from robo47_qp.tasks.wipe.board import SURFACE, WipeSettings

_STROKE, _LANES = 0.09, (-0.04, 0.0, 0.04)
"""Half the length of a stroke along the board's y, and the positions of the strokes along its x
[m]."""
_ABOVE = 0.015
"""Height of the sponge above the nominal surface before it is lowered [m]."""
_SETTLED, _READ = 0.6, 0.2
"""Time from contact until the force has settled, and in which it is then measured [s]."""
_SWIFTLY, _GENTLY = 0.7, 0.3
"""Speed without contact of a sponge that is lowered, relative to the largest: where the force is
measured exactly, and where touches have to be even, and the sponge may not slip [-]."""
_DAMPED = 20.0
"""Damping of the sponge on the board, relative to its apparent mass: 0.8 to 1 of the critical one
[1/s]."""
_FIRST_TOUCHES, _TOUCHES = 8, 4
"""Touches before the first stroke and before each other one, where the wrist errs."""
_FOAM, _CLEAR = 1100.0, 4e-3
"""Nominal stiffness of the foam, which is known as well as the mass of the sponge [N/m], and by how
much further than the foam gives way the tool rises between two touches [m]."""
_UNLOADING = (5e-4, 5e-3)
"""Rise of the tool in which the foam, still pressed, tells its stiffness [m]."""
_TOUCH_ERROR = 0.2
"""Standard deviation of the force that a touch tells [N]."""
_CREEP = (0.0076, 1.29e-5, 0.005)
"""Rate at which the force of a pressed sponge falls, as it creeps between the fingers: that of a
soft one [N/s], what it grows by with its stiffness [m/s], and the standard deviation [N/s]."""
_CAREFUL, _DRAGGED = 0.0125, 0.0137
"""Speed of the sponge that is wiped by the foam [m/s], and by how much dragged foam rises at the
same force, for its speed and its coefficient of friction [s]."""
_FRICTION, _TRUSTED = 0.5, 20
"""Coefficient of friction that is expected, and how many readings it counts as."""
_BEGINS, _SLOWLY = 1.2, 0.3
"""Time in which a stroke begins slowly [s], and its pace meanwhile [-]: the joints have turned by
then, and what their friction does to the force is made up for."""
_EASED, _RELIEVED, _AWAY = 6.0, 2.2, 0.3
"""Times in which a sponge that has slid is relieved, and another one, and in which it goes away
from the board then [s]: it slips back if that is fast."""
_LAID, _SET_DOWN, _LOOSE = 1.0, 2.5, 2.0
"""Force with which the sponge is laid down [N], which its foam gives way to by 1 mm, how long that
may take [s], and force of fingers in which it settles before they open [N]."""


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
        hand = (yield from self._lined_up()) if camera_errs(self.sensed) else self
        if wrist_errs(self.sensed):
            yield from hand._wipe_by_foam()
        else:
            yield from self._touch_down(self._force)
            # Level, at the height at which the tool is now.
            strokes = hand.strokes(self.sensed.tool_pose().translation()[2])
            speed = self.settings.speed
            yield self._press("wipe", self._force, waypoints=strokes, speed=speed)
            yield self._rise("lift off", self._clear(_FOAM), _RELIEVED)
        yield self._line("leave the board", self._up(self.sensed.tool_pose()))

    def _lined_up(self) -> Generator[StepLike, None, Self]:
        """Return the wiper of the board as it lies below the sponge, which is then over its corner.

        There, both are seen with the same error of the camera's calibration. Foam over an edge of
        the board presses otherwise.
        """
        since = self.sensed.time
        seen = (yield from self._look(None, self.good_enough)).translation()
        if self.sensed.seen_time(self.item.name) < since:
            # The fingers hide it.
            return self
        here = self.sensed.tool_pose().translation()
        shift = np.array([here[0] - seen[0], here[1] - seen[1], 0.0])
        hand = replace(self, T_world_board=SE3.from_translation(shift) @ self.T_world_board)
        yield Move(waypoints=(self._line("beside", hand._over(_LANES[0], -_STROKE, here[2])),))
        return hand

    def _wipe_by_foam(self) -> Generator[StepLike, None, None]:
        """Wipe with the foam as the sensor of the force: a spring, which does not drift.

        Before each stroke, short touches tell how high the tool is when the sensor at the wrist
        feels what is asked for, each with the readings of the free wrist before and after it.
        """
        foam = FoamSpring(force=self.settings.force)
        softest = _FOAM * (1.0 - float(self.sensed.sheet.noise["mass_tolerance"] or 0.0))
        for i, x in enumerate(_LANES):
            if i:
                height = self.sensed.tool_pose().translation()[2]
                beside = self._over(x, -_STROKE, height)
                yield Move(waypoints=(self._line(f"to stroke {i + 1}", beside),))
            free = yield from read_free_wrist(self.sensed)
            for _ in range(_TOUCHES if i else _FIRST_TOUCHES):
                felt = partial(self._force_from, free.force)
                touch = yield from self._touch_down(felt)
                lift = Unloading(self.sensed, felt)
                rise = self._clear(foam.stiffness if foam.touched else softest)
                yield self._rise("lift off", rise - _CLEAR, _RELIEVED, lift.read)
                yield self._rise("clear", _CLEAR, _AWAY)
                after = yield from read_free_wrist(self.sensed)
                foam.add(touch, lift, free, after)
                free = after
            touch = yield from self._touch_down(partial(self._force_from, free.force))
            end = self._over(x, _STROKE, self.sensed.tool_pose().translation()[2])
            stroke = self._line(f"stroke {i + 1}", end)
            still = partial(foam.force_at, self.sensed, touch)
            dragged = partial(foam.force_dragged, self.sensed, touch, free.force, self._y())
            yield self._press("settle", still, seconds=_SETTLED)
            yield self._stroke(stroke, still, dragged)
            yield self._press("stop", still, seconds=_SETTLED)
            foam.pressed += self.sensed.time - touch.since + 0.5 * _EASED
            yield self._rise("ease", self._clear(foam.stiffness) - _CLEAR, _EASED)
            yield self._rise("clear", _CLEAR, _AWAY)

    def _stroke(
        self, line: Waypoint, still: Callable[[], float], dragged: Callable[[], float]
    ) -> Press:
        """Return the stroke along a line, which begins slowly, with the force as the foam tells
        it where the sponge is still and where it is dragged [N]."""
        begun = self.sensed.time + _BEGINS

        def slow() -> bool:
            return self.sensed.time < begun

        return self._press(
            "wipe",
            lambda: still() if slow() else dragged(),
            waypoints=(line,),
            speed=_CAREFUL,
            pace=lambda: _SLOWLY if slow() else 1.0,
        )

    def _let_down(self, T_world_item: SE3, T_world_goal: SE3) -> Generator[StepLike, None, None]:
        """See `ItemHandler._let_down`; the sponge is then lowered until it touches.

        It has crept up between the fingers: let go above the table, it would bounce aside.
        """
        free = yield from read_free_wrist(self.sensed, untouched=True)
        yield from ItemHandler._let_down(self, T_world_item, T_world_goal)
        step = self._press("set down", partial(self._force_from, free.force), seconds=_SET_DOWN)
        yield replace(step, force=_LAID)
        yield Grasp(name="loosen", force=_LOOSE)

    def _clear(self, stiffness: float) -> float:
        """Return by how much the tool rises to lift the sponge, of a stiffness [N/m], off [m]."""
        return 1.1 * self.settings.force / stiffness + _CLEAR

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

    def _rise(
        self, name: str, way: float, seconds: float, observe: Callable[[], None] | None = None
    ) -> Press:
        """Return the step straight up by a way [m] in about a time [s], with the arm stiff."""
        x, y, z = (T := self.sensed.tool_pose()).translation()
        up = SE3.from_rotation_and_translation(T.rotation(), np.array([x, y, z + way]))
        line, speed = self._line(name, up), way / seconds
        step = self._press(name, self._force, waypoints=(line,), speed=speed)
        return replace(step, force=0.0, observe=observe)

    def to_board(self) -> tuple[Waypoint, Waypoint]:
        """Return the waypoints above the first stroke, and down to a little above the board."""
        height = SURFACE + 0.5 * self.item.height + _ABOVE
        strokes, start = self.strokes(height), self._over(_LANES[0], -_STROKE, height)
        payload = self.item.payload(SE3.identity())
        hover = Waypoint(name="hover", target=start, motion=Motion.LIN, carried=payload)
        above = self._up(start)
        onward = (hover, *strokes)
        return Waypoint(name="to the board", target=above, carried=payload, onward=onward), hover

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


class Unloading:
    """The rise of a sponge off the board, as it is measured."""

    def __init__(self, sensed: Sensed, felt: Callable[[], float]) -> None:
        """Begin before it; `felt` returns the force of the sponge [N]."""
        self._sensed, self._felt = sensed, felt
        self._low = float(sensed.tool_pose().translation()[2])
        self._readings: list[tuple[float, float, float]] = []

    def read(self) -> None:
        """Measure time, height of the tool and force."""
        height = float(self._sensed.tool_pose().translation()[2])
        least, most = _UNLOADING
        if least <= height - self._low <= most:
            self._readings.append((self._sensed.time, height, self._felt()))

    def stiffness(self, drift: float) -> float:
        """Return the stiffness of the sponge [N/m], with a wrist that drifts [N/s]."""
        time, height, force = np.array(self._readings).T
        return -float(np.polyfit(height - height.mean(), force - drift * time, 1)[0])


class FoamSpring:
    """The foam as a sensor of the force: what the force is at a height of the tool.

    With a stiffness k, the height with the force F that is asked for is h - c t: as it is pressed,
    the sponge creeps between the fingers, t the time in contact so far. Both are estimated by
    least squares from touches, with what creep is usual; k from how the force falls when the
    sponge is lifted. Foam that is dragged at a speed v rises by T µ v, and the drag tells µ.
    """

    def __init__(self, force: float) -> None:
        """Start without touches; `force` is what is asked for [N]."""
        self.force, self.pressed = force, 0.0
        self._touches: list[tuple[float, float, float]] = []
        self._slopes: list[float] = []
        self._drag, self._count = _TRUSTED * _FRICTION * force, _TRUSTED

    @property
    def touched(self) -> bool:
        """Whether there was a touch."""
        return bool(self._slopes)

    @property
    def stiffness(self) -> float:
        """k [N/m]."""
        return float(np.clip(np.median(self._slopes or [_FOAM]), 0.3 * _FOAM, 2.0 * _FOAM))

    def add(self, touch: Touch, lift: Unloading, before: FreeWrist, after: FreeWrist) -> None:
        """Take in a touch between two readings of the free wrist, whose drift is taken off."""
        time, height, force = touch.mean
        drift = float(after.force[2] - before.force[2]) / (after.time - before.time)
        force -= drift * (time - before.time)
        self._touches.append((self.pressed + time - touch.since, height, force))
        self._slopes.append(lift.stiffness(drift))
        self.pressed += _SETTLED + _READ + 0.5 * _RELIEVED

    def force_at(self, sensed: Sensed, touch: Touch) -> float:
        """Return the force while the sponge is at rest on the board after a touch [N]."""
        k, pressed = self.stiffness, self.pressed + sensed.time - touch.since
        times, heights, forces = np.array(self._touches).T
        firm, growth, spread = _CREEP
        usual = firm + growth * k
        rows = np.append(np.column_stack([np.ones(len(times)), -times]), [[0.0, 1.0]], axis=0)
        values = np.append(k * heights + forces - self.force, usual)
        weights = np.append(np.full(len(times), 1.0 / _TOUCH_ERROR), 1.0 / spread)
        fitted = np.linalg.lstsq(weights[:, None] * rows, weights * values, rcond=None)[0].tolist()
        height = float(sensed.tool_pose().translation()[2])
        return float(self.force + fitted[0] - fitted[1] * pressed - k * height)

    def force_dragged(self, sensed: Sensed, touch: Touch, free: Vector, way: Vector) -> float:
        """Return the force while the sponge is dragged over the board [N].

        Args:
            sensed: What is sensed.
            touch: The touch before.
            free: What the free wrist read before it (3,) [N].
            way: Direction in which the sponge is dragged (3,) [-].
        """
        self._drag += -float((sensed.felt_force() - free).dot(way))
        self._count += 1
        friction = max(self._drag / (self._count * self.force), 0.0)
        return self.force_at(sensed, touch) + self.stiffness * _DRAGGED * friction * _CAREFUL
