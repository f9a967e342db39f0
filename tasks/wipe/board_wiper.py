"""BoardWiper: the steps that move a sponge over a board."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Self

import numpy as np
from mink import SE3

from robo47_qp.motion.waypoint import Motion, Waypoint, tool_down
from robo47_qp.run.contact_steps import Press
from robo47_qp.run.failure import Cause, Condition
from robo47_qp.run.steps import Grasp, Move, StepLike
from robo47_qp.tasks.handling.item_handler import ItemHandler
from robo47_qp.tasks.handling.pose_estimate import camera_errs
from robo47_qp.tasks.handling.wrist import read_free_wrist, wrist_errs
from robo47_qp.tasks.heading import heading
from robo47_qp.tasks.wipe.board import SURFACE, WipeSettings
from robo47_qp.tasks.wipe.foam import (
    CAREFUL,
    RELIEVED,
    SETTLED,
    FoamSpring,
    Touch,
    Unloading,
)

_STROKE, _LANES = 0.09, (-0.04, 0.0, 0.04)
"""Half the length of a stroke along the board's y, and the positions of the strokes along its x
[m]."""
_ABOVE = 0.015
"""Height of the sponge above the nominal surface before it is lowered [m]."""
_SWIFTLY, _GENTLY = 0.7, 0.3
"""Speed without contact of a sponge that is lowered, relative to the largest: where the force is
measured exactly, and where touches have to be even, and the sponge may not slip [-]."""
_DAMPED = 20.0
"""Damping of the sponge on the board, relative to its apparent mass: 0.8 to 1 of the critical one
[1/s]."""
_CLEAR = 4e-3
"""By how much further than the foam gives way the tool rises between two touches [m]."""
_FIRST_TOUCHES, _TOUCHES = 7, 4
"""Touches before the first stroke and before each other one, where the wrist errs."""
_EASED, _FREED, _AWAY = 6.0, 2.0, 0.3
"""Times in which a sponge that has slid is relieved, and then goes away from the board, and in
which one that was pressed only goes away [s]. It slips back if the first is short; the second lets
the compensation lose what dragged at the sponge."""
_BEGINS, _SLOWLY = 2.0, 0.25
"""Time in which a stroke begins slowly [s], and its pace meanwhile [-]: the joints have turned by
then, and what their friction does to the force is made up for."""
_RUN_IN = 0.02
"""Way of the slow drag before all strokes [m]."""
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
            yield self._rise("lift off", FoamSpring(self.settings.force).way + _CLEAR, RELIEVED)
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
        yield from self._run_in(foam)
        for i, x in enumerate(_LANES):
            beside = self._over(x, -_STROKE, self.sensed.tool_pose().translation()[2])
            yield Move(waypoints=(self._line(f"to stroke {i + 1}", beside),))
            free = yield from read_free_wrist(self.sensed)
            for _ in range(_TOUCHES if i else _FIRST_TOUCHES):
                felt = partial(self._force_from, free.force)
                touch = yield from self._touch_down(felt)
                lift = Unloading(self.sensed, felt)
                yield self._rise("lift off", foam.way, RELIEVED, lift.read)
                yield self._rise("clear", _CLEAR, _AWAY)
                after = yield from read_free_wrist(self.sensed)
                foam.add(touch, lift, free, after)
                free = after
            touch = yield from self._touch_down(partial(self._force_from, free.force))
            end = self._over(x, _STROKE, self.sensed.tool_pose().translation()[2])
            stroke = self._line(f"stroke {i + 1}", end)
            still = partial(foam.force_at, self.sensed, touch)
            dragged = partial(foam.force_dragged, self.sensed, touch, free.force, self._y())
            yield self._press("settle", still, seconds=SETTLED)
            yield self._stroke("wipe", stroke, CAREFUL, (still, dragged))
            # The arm holds what disturbs it: joints that stick would leap at the next start.
            yield self._press("stop", still, seconds=SETTLED, insists=_never)
            foam.pressed += self.sensed.time - touch.since + 0.5 * _EASED
            yield replace(self._rise("ease", foam.way, _EASED), insists=_never)
            yield self._rise("clear", _CLEAR, _FREED)

    def _run_in(self, foam: FoamSpring) -> Generator[StepLike, None, None]:
        """Drag the sponge a little, slowly, and lift it, which tells how stiff its foam is.

        It turns between the fingers the first time that it is dragged, and creeps more than later.
        """
        free = yield from read_free_wrist(self.sensed)
        felt = partial(self._force_from, free.force)
        yield from self._touch_down(felt)
        height = self.sensed.tool_pose().translation()[2]
        line = self._line("run in", self._over(_LANES[0], _RUN_IN - _STROKE, height))
        yield self._stroke("run in", line, _SLOWLY * CAREFUL, (felt, felt))
        lift = Unloading(self.sensed, felt)
        least, most = foam.ways(float(self.sensed.sheet.noise["mass_tolerance"] or 0.0))
        yield self._rise("ease", least, _EASED, lift.read)
        if most > least:
            yield self._rise("lift off", most - least, RELIEVED)
        yield self._rise("clear", _CLEAR, _AWAY)
        foam.soften(lift, free, (yield from read_free_wrist(self.sensed)))

    def _stroke(
        self,
        name: str,
        line: Waypoint,
        speed: float,
        felt: tuple[Callable[[], float], Callable[[], float]],
    ) -> Press:
        """Return the step along a line, which begins slowly.

        Args:
            name: Of the step.
            line: Where it ends.
            speed: From when it is no longer slow [m/s].
            felt: What tells the force [N], while it is slow and from then on.
        """
        still, dragged = felt
        fast = self.sensed.time + _BEGINS

        def slow() -> bool:
            return self.sensed.time < fast

        return self._press(
            name,
            lambda: still() if slow() else dragged(),
            waypoints=(line,),
            speed=speed,
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

    def _touch_down(self, felt: Callable[[], float]) -> Generator[StepLike, None, Touch]:
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

    def _pressed(self, touch: Touch) -> Condition:
        """Return the condition that the sponge has been pressed for long enough to settle."""

        def against() -> str | None:
            if touch.done:
                return None
            return (
                f"the sponge presses with {touch.felt():.2f} N, "
                f"{self.settings.force:.2f} N are asked for"
            )

        return Condition(name="the sponge is on the board", cause=Cause.TIMEOUT, against=against)


def _never() -> bool:
    return False
