"""Write tables, figures and pictures of README and documentation anew, from docs/results/*.json."""

import sys
from dataclasses import dataclass
from pathlib import Path

from robo47_qp.report.importing import importing

with importing():
    from rich.console import Console

    from robo47_qp.cli import FAILED, OK, main
    from robo47_qp.evaluation.benchmarks.robustness.plot import plot_robustness
    from robo47_qp.files import write_text
    from scenarios.papers.blocks import rendered
    from scenarios.papers.evaluations import curves_of
    from scenarios.papers.kept import is_kept, kept
    from scenarios.papers.tables import TABLES
    from scenarios.robustness import title_of

ROOT = Path(__file__).resolve().parents[1]
ROBUSTNESS = "robustness_pick_place"
"""Kept campaign of which docs/ has a picture of the same name."""


def pages() -> list[Path]:
    """The pages that may hold tables."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


@dataclass(frozen=True, kw_only=True)
class TablesOptions:
    """Options of this scenario."""

    check: bool = False
    """Write nothing; exit code 1 where a page and the results differ."""


def run(options: TablesOptions, console: Console) -> int:
    """Render all pages; returns the exit code."""
    stale = []
    for page in pages():
        before = page.read_text(encoding="utf-8")
        after = rendered(before, TABLES)
        if after != before:
            stale.append(str(page.relative_to(ROOT)))
            if not options.check:
                write_text(page, after.removesuffix("\n"))
    if not options.check and is_kept(ROBUSTNESS):
        picture = ROOT / "docs" / f"{ROBUSTNESS}.png"
        plot_robustness(curves_of(ROBUSTNESS), title_of(kept(ROBUSTNESS)), picture)
    word = "differ from their results" if options.check else "written"
    console.print(f"{', '.join(stale) or 'no page'}: {word}", soft_wrap=True)
    return FAILED if stale and options.check else OK


if __name__ == "__main__":
    sys.exit(main(TablesOptions, run, __doc__))
