"""How the recording of a comparison opens: a page per solver, and the figures."""

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

FAILURE = "failure"
"""Timeline: the number of a failure, counted for each solver on its own."""
FIGURES = "figures"
"""Entity of the tables."""


def pages(solvers: Sequence[str]) -> rrb.Blueprint:
    """One tab for each solver, the figures first."""
    return rrb.Blueprint(
        rrb.Tabs(
            rrb.TextDocumentView(name="Figures", origin=f"/{FIGURES}"),
            *(_page(solver) for solver in solvers),
            active_tab=min(1, len(solvers)),
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=FAILURE, play_state="paused", fps=2.0),
        auto_layout=False,
        auto_views=False,
    )


def _page(solver: str) -> rrb.Horizontal:
    origin = f"/{rr.escape_entity_path_part(solver)}"
    scene = rrb.Spatial3DView(
        name="Targets and failures",
        origin=origin,
        contents=["$origin/**", "- $origin/why"],
        background=(24, 27, 32),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=(1.9, -1.5, 1.25), look_target=(0.0, 0.0, 0.4), eye_up=(0, 0, 1)
        ),
    )
    why = rrb.TextDocumentView(name="This failure", origin=f"{origin}/why")
    return rrb.Horizontal(scene, why, column_shares=[3, 1], name=solver)
