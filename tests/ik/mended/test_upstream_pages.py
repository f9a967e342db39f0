"""The pages on defects of mink: their programs print what is shown, and what they say is so."""

import contextlib
import io
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

PAGES = Path(__file__).resolve().parents[3] / "docs" / "upstream"
REPORTS = sorted(path for path in PAGES.glob("*.md") if path.name != "README.md")


def block(page: Path, language: str) -> str:
    (found,) = re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)
    return str(found)


def printed(program: str) -> str:
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(program, "page", "exec"), {})
    return out.getvalue()


@pytest.mark.parametrize("page", REPORTS, ids=lambda page: page.stem)
def test_the_program_of_a_page_prints_what_it_shows(page: Path) -> None:
    """Where this fails mink has changed: see whether the page and the mended part can go."""
    assert printed(block(page, "python")) == block(page, "text")


@pytest.mark.parametrize("page", REPORTS, ids=lambda page: page.stem)
def test_a_page_is_complete_and_short(page: Path) -> None:
    text = page.read_text("utf-8")
    for part in ("What happens", "Expected", "Cause", "Suggested mend"):
        assert f"**{part}.**" in text
    assert len(block(page, "python").splitlines()) <= 20


def test_the_index_names_every_page() -> None:
    named = set(re.findall(r"\]\((\w+\.md)\)", (PAGES / "README.md").read_text("utf-8")))
    assert named == {page.name for page in REPORTS}


def test_mujoco_makes_contacts_of_the_world_and_the_first_moving_link() -> None:
    m = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/><body><joint/><geom size=".1"/></body>'
        "</worldbody></mujoco>"
    )
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    assert d.ncon == 1


def test_the_limits_of_the_coefficients_of_minks_series_are_those_told() -> None:
    x = 0.05
    B = (x - np.sin(x)) / x**3
    D = (2.0 * x - 3.0 * np.sin(x) + x * np.cos(x)) / (2.0 * x**5)
    assert pytest.approx(1 / 6 - x**2 / 120, abs=1e-8) == B
    assert pytest.approx(1 / 120, abs=1e-5) == D
