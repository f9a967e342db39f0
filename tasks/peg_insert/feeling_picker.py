"""FeelingPicker: picks a peg that tips over easily, where neither wrist nor camera is exact."""

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from mink import SE3

from robo47_qp.run.contact_steps import Press
from robo47_qp.run.failure import Cause, Condition, StepFailed
from robo47_qp.run.steps import Grasp, Release, StepLike, Wait
from robo47_qp.tasks.handling.compliant_grasp import centre
from robo47_qp.tasks.handling.held_item import HeldItem
from robo47_qp.tasks.handling.item_handler import SETTLE, UNPLANNED, ItemHandler
from robo47_qp.tasks.handling.pose_estimate import camera_errs
from robo47_qp.tasks.handling.wrist import FreeWrist, read_free_wrist
from robo47_qp.tasks.heading import tilt
from robo47_qp.tasks.item import turned_about_vertical
from robo47_qp.tasks.peg_insert.peg import DEPTH
from robo47_qp.tasks.peg_insert.peg_inserter import PegInserter

_LEANS, _RIGHTED, _RIGHT_DAMPING, _RIGHTINGS = 0.4, 0.02, 800.0, 3
"""Force of a peg that leans between the fingers and on the ground, or is pressed on it, and of one
that no longer does [N]; damping of the arm that rights it [N·s/m], and how often it does so."""
_IN_HOLE, _CLEAR = 8e-3, 12e-3
"""Height of a peg above where it stood that means that it stands in the hole, and of its lower end
above the hole once it is out [m]."""
_LIES = 0.5
"""Tilt at which a peg no longer stands [rad]; it cannot be inserted."""
_PULL, _PULL_SPEED = 15.0, 0.01
"""Largest force that draws a peg out [N], and speed at which it comes out [m/s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FeelingPicker(PegInserter):
    """Picks the peg from the table or out of the hole, and draws it out."""

    def pick(self, seen: SE3 | None = None) -> Generator[StepLike, None, HeldItem]:
        """See `ItemHandler.pick`; a peg that stands in the hole is higher than before."""
        height = float(self.sensed.seen_pose(self.item.name).translation()[2])
        on_table = self.resting is None or height <= self.resting + _IN_HOLE
        hand = self if on_table else replace(self, resting=None)
        return (yield from ItemHandler.pick(hand, seen))

    def _come_around(self, T_world_item: SE3) -> Generator[StepLike, None, None]:
        """See `ItemHandler._come_around`; before, fingers that close across have centred the peg.

        By the edge of the fingers, it would be held loosely. Fails with GRASP where the peg lies.
        """
        lean = tilt(T_world_item)
        if lean > _LIES:
            evidence = f"the {self.item.name} lies: {np.degrees(lean):.0f}° from upright"
            yield given_up("approach", Cause.GRASP, "the peg stands", evidence)
        come_around = ItemHandler._come_around
        if not camera_errs(self.sensed) or self.resting is None:
            yield from come_around(self, T_world_item)
            return
        for turn in (0.5 * np.pi, -0.5 * np.pi):
            try:
                yield from come_around(replace(self, across=self.across + turn), T_world_item)
            except StepFailed as error:
                if error.failure.cause not in UNPLANNED:
                    raise
                continue
            across = Grasp(name="close across", force=self.force)
            width = yield from centre(self.sensed, self.item, T_world_item, across)
            yield Release(name="open around", width=width)
            here = self.sensed.tool_pose()
            yield self._line("turn", turned_about_vertical(here, -turn, here.translation()))
            return
        # The wrist does not turn so far.
        yield from come_around(self, T_world_item)

    def _weighed(self, free: FreeWrist) -> Generator[StepLike, None, Self]:
        """See `ItemHandler._weighed`; a peg is righted and let stand first, as it would leap.

        One in the hole, which has been weighed before, is drawn out; fails with TIMEOUT if it
        sticks.
        """
        right = Press(
            name="right",
            axis=self._axis,
            force=_RIGHTED,
            damping=_RIGHT_DAMPING,
            felt=lambda: 0.0,
            seconds=0.4,
            during=(self._held(Cause.GRASP),),
        )
        for _ in range(_RIGHTINGS):
            yield from self._give_way(right, free, _LEANS)
        if self.resting is None:
            yield from self._pulled_out()
            return self
        return (yield from PegInserter._weighed(self, free))

    def _give_way(
        self, step: Press, free: FreeWrist, least: float
    ) -> Generator[StepLike, None, None]:
        """Go with a step to where something pushes, if with a least force [N]."""
        felt = yield from read_free_wrist(self.sensed)
        push = felt.force - free.force
        size = float(np.linalg.norm(push))
        if size > least:
            way = push / size
            yield replace(
                step,
                axis=way,
                felt=lambda: float((free.force - self.sensed.felt_force()).dot(way)),
            )

    def draw_out(self) -> Generator[StepLike, None, bool]:
        """See `PegInserter.draw_out`; the arm is stiff, and pulls with a bounded force."""
        try:
            yield from self._pulled_out()
        except StepFailed as error:
            if error.failure.cause is not Cause.TIMEOUT:
                raise
            return False
        return True

    def _pulled_out(self) -> Generator[StepLike, None, None]:
        """Pull the peg out of the hole and leave it; fails with TIMEOUT if it sticks."""
        start, weight = self.sensed.tool_pose(), 9.81 * self.item.mass

        def against() -> str | None:
            risen = -self._depth(start)
            return None if risen >= DEPTH + _CLEAR else f"the peg has risen by {1e3 * risen:.1f} mm"

        yield Press(
            name="draw out",
            axis=self._axis,
            force=_PULL,
            damping=_PULL / _PULL_SPEED,
            felt=lambda: -float(self.sensed.felt_force().dot(self._axis)) - weight,
            seconds=6.0,
            until=Condition(name="the peg is out", cause=Cause.TIMEOUT, against=against),
        )
        leave = self._line("leave the hole", self._up(self.sensed.tool_pose()))
        yield replace(leave, carried=self._carried())

    def let_go(self, name: str = "release") -> Generator[StepLike, None, None]:
        """See `PegInserter.let_go`; the arm, which had pushed at the peg, comes back."""
        yield from PegInserter.let_go(self, name)
        yield from self._come_back()

    def _come_back(self) -> Generator[StepLike, None, None]:
        """Wait until the arm is where it should be, after it pushed at what it no longer touches.

        It comes back once the wrist has been read anew: by one that has drifted, it would seem to
        touch.
        """
        yield from read_free_wrist(self.sensed, untouched=True)
        yield Wait(name="settle", seconds=SETTLE)

    def back_off(self) -> Generator[StepLike, None, None]:
        """See `ItemHandler.back_off`; a peg that sticks in the hole is not torn out."""
        yield from self.let_go("open gripper")
        yield from ItemHandler.back_off(self)


def given_up(step: str, cause: Cause, statement: str, evidence: str) -> Wait:
    """Return the step that fails: an attempt that is given up counts as one that has failed."""
    condition = Condition(name=statement, cause=cause, against=lambda: evidence)
    return Wait(name=step, seconds=0.0, until=condition)
