"""LinError: why the arm cannot follow a tool path."""

from mink import SE3

from robo47_qp.arrays import Vector
from robo47_qp.errors import Obstacle, Robo47Error


class LinError(Robo47Error):
    """A tool path that the arm cannot follow.

    Attributes:
        fraction: Where on the path, 0 at its start and 1 at its end.
        obstacle: What stands in the way.
        joint: The joint concerned, where there is one.
        q: The last configuration before, where there is one.
        T_world_next: The pose that is not reached from there, where there is one.
    """

    def __init__(
        self,
        fraction: float,
        reason: str,
        obstacle: Obstacle,
        joint: str | None = None,
        q: Vector | None = None,
        T_world_next: SE3 | None = None,
    ) -> None:
        """Tell where on the path and why."""
        super().__init__(f"the path fails {100 * fraction:.0f} % of the way: {reason}")
        self.fraction = fraction
        self.obstacle = obstacle
        self.joint = joint
        self.q = None if q is None else q.copy()
        self.T_world_next = T_world_next
