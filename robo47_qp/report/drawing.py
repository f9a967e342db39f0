"""Draws the picture of a run from plain numbers; also a program, which reads them from its input.

It imports nothing of this package, and Matplotlib where something is drawn: both as a program and
in a program that has one, it starts quickly.
"""

import json
import sys
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Numbers: TypeAlias = NDArray[Any]
_MARGINS = {
    "left": 0.07,
    "right": 0.99,
    "bottom": 0.075,
    "top": 0.945,
    "wspace": 0.18,
    "hspace": 0.32,
}
"""Edges of the panels and spaces between them, as shares of the figure and of a panel."""
_LETTER = 0.0105
"""Width of a letter of a phase's name, as a share of the panel."""
_ACROSS, _ENTRY = 0.98 / _LETTER, 5.5
"""How many letters a legend has room for, and how many an entry takes beside its name."""
_RED, _GREY = "#c2410c", "#9aa3ad"
_TOOLS = ("#2563a8", "#15803d", "#7e22ce")
"""What is measured of the tools, one after the other."""
_MARKS = "so^Dv"
"""Where an object ends, one after the other."""


class Picture(NamedTuple):
    """What is drawn of a run."""

    words: Mapping[str, Any]
    """`title`, `unit` of joint errors, and the names of `joints`, `objects`, `phases`, `tools`."""
    numbers: Mapping[str, Numbers]
    """By row: `time` [s], `q` errors (N, n) in that unit, those of the m tools, `tool` (N, m) [mm],
    `tau` (N, n) [%], `at` and `asked`, the positions of the tools (N, m, 3), and those of objects
    (N, k, 3) [m]. `starts`: rows at which phases begin."""

    def packed(self) -> bytes:
        """Return all of it as bytes."""
        out = BytesIO()
        arrays: Any = self.numbers
        np.savez(out, words=np.array(json.dumps(self.words)), **arrays)
        return out.getvalue()

    @classmethod
    def unpacked(cls, data: bytes) -> "Picture":
        """Return what `packed` made."""
        with np.load(BytesIO(data), allow_pickle=False) as found:
            numbers = {name: found[name] for name in found.files}
        return cls(json.loads(str(numbers.pop("words"))), numbers)


def _figure(size: tuple[float, float], **options: Any) -> "Figure":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=110, **options)
    FigureCanvasAgg(figure)
    return figure


def draw_curves(panels: Mapping[str, Mapping[str, tuple[Numbers, Numbers]]]) -> "Figure":
    """Return a figure with a panel per label, and in it a curve per name: times [s] and values."""
    figure = _figure((10.0, 2.4 * len(panels)), layout="constrained")
    for axes, (label, curves) in zip(
        np.ravel(figure.subplots(len(panels), sharex=True)), panels.items(), strict=True
    ):
        for name, (t, values) in curves.items():
            axes.plot(t, values, lw=1.0, label=name)
        axes.set_ylabel(label)
        axes.grid(alpha=0.3, lw=0.5)
    figure.axes[0].legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)
    figure.axes[-1].set_xlabel("time [s]")
    return figure


def draw(picture: Picture) -> "Figure":
    """Return the figure: the tools' paths from above and from the side, errors and torques."""
    figure = _figure((12.0, 7.2))
    words, numbers = picture
    figure.suptitle(words["title"])
    if not len(numbers["time"]):
        return figure
    # Fixed margins: a layout by the size of all labels takes half of the time of drawing.
    axes = figure.subplot_mosaic(
        [["above", "joint"], ["above", "tool"], ["side", "torque"]],
        width_ratios=[1.0, 1.6],
        gridspec_kw=_MARGINS,
    )
    t, joints = numbers["time"], words["joints"]
    _tool_paths(axes["above"], picture, (0, 1))
    _tool_paths(axes["side"], picture, (1, 2))
    for k, tool in enumerate(words["tools"]):
        axes["tool"].plot(t, numbers["tool"][:, k], lw=0.8, color=_tool_colour(k), label=tool)
    if len(words["tools"]) == 1:
        axes["above"].legend(loc="best", edgecolor="none")
    else:
        small: Any = {"ncols": 3, "frameon": False, "fontsize": 8, "borderpad": 0}
        axes["above"].margins(y=0.15)
        axes["above"].legend(loc="upper center", **small)
        axes["tool"].legend(loc="lower left", **small)
    for i, joint in enumerate(joints):
        axes["joint"].plot(t, numbers["q"][:, i], lw=0.8, label=joint, **line_look(i))
        axes["torque"].plot(t, numbers["tau"][:, i], lw=0.8, **line_look(i))
    axes["joint"].set_ylabel(f"joint error [{words['unit']}]")
    across = max(1, int(_ACROSS / (_ENTRY + max(map(len, joints)))))
    axes["joint"].legend(ncols=across, frameon=False, fontsize=8, loc="upper center", borderpad=0)
    axes["joint"].margins(y=0.1 + 0.15 * -(-len(joints) // across))
    axes["tool"].set_ylabel("tool error [mm]")
    axes["torque"].set_ylabel("torque [% of limit]")
    axes["torque"].set_xlabel("time [s]")
    _mark_phases(axes["tool"], picture)
    for name in ("joint", "tool", "torque"):
        axes[name].set_xlim(0.0, float(t[-1]))
        axes[name].grid(alpha=0.3, lw=0.5)
        # A phase that ended in its first period has no row.
        for start in t[numbers["starts"][1:][numbers["starts"][1:] < len(t)]]:
            axes[name].axvline(float(start), color=_GREY, lw=0.5, ls=":")
    return figure


def line_look(i: int) -> dict[str, Any]:
    """Return colour and dashes of the i-th line of a panel: colours come again after ten."""
    return {"color": f"C{i % 10}", "ls": ("-", "--", ":")[i // 10 % 3]}


def _tool_colour(k: int) -> str:
    return _TOOLS[k % len(_TOOLS)]


def write(picture: Picture, path: str | Path) -> None:
    """Draw the figure and write it as a PNG, quickly rather than as small as can be.

    Raises:
        OSError, ValueError: The file cannot be written.
    """
    draw(picture).savefig(path, pil_kwargs={"compress_level": 1})


def _tool_paths(axes: "Axes", picture: Picture, plane: tuple[int, int]) -> None:
    i, j = plane
    words, numbers = picture
    for k, tool in enumerate(words["tools"]):
        asked, at = numbers["asked"][:, k], numbers["at"][:, k]
        look: Any = {"color": _tool_colour(k), "lw": 4.0, "alpha": 0.4}
        axes.plot(at[:, i], at[:, j], label=f"{tool}, measured", **look)
        axes.plot(asked[:, i], asked[:, j], color=_RED, lw=1.0, label="" if k else "reference")
    for k, name in enumerate(words["objects"]):
        place = numbers["objects"][:, k]
        look = {"color": _GREY, "marker": _MARKS[k % len(_MARKS)], "markevery": [-1]}
        axes.plot(place[:, i], place[:, j], lw=1.2, ms=7, label=name, zorder=1, **look)
    axes.set_xlabel(f"{'xyz'[i]} [m]")
    axes.set_ylabel(f"{'xyz'[j]} [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3, lw=0.5)


def _mark_phases(axes: "Axes", picture: Picture) -> None:
    t, starts = picture.numbers["time"], picture.numbers["starts"].tolist()
    axes.margins(y=0.35)
    place: Any = {"transform": axes.get_xaxis_transform(), "ha": "center", "va": "top"}
    ends, edges = [*starts[1:], len(t)], [-np.inf] * 2
    for phase, start, end in zip(picture.words["phases"], starts, ends, strict=True):
        if end - start > 0.05 * len(t):
            middle = float(np.mean(t[[start, end - 1]]))
            half = 0.5 * _LETTER * len(phase) * (t[-1] - t[0])
            # One that would run into the last one goes below it.
            below = int(middle - half < edges[0])
            edges[below] = middle + half
            axes.text(middle, 0.86 if below else 0.96, phase, fontsize=8, **place)


def _nothing() -> Picture:
    """Return a picture of an arm with one joint that rests."""
    words = {
        "title": "-",
        "joints": ["-"],
        "unit": "-",
        "tools": ["-"],
        "objects": [],
        "phases": ["-"],
    }
    numbers = {name: np.zeros((2, 1)) for name in ("q", "tool", "tau")}
    places = {name: np.zeros((2, k, 3)) for name, k in (("at", 1), ("asked", 1), ("objects", 0))}
    times = {"time": np.arange(2.0), "starts": np.zeros(1, dtype=int)}
    return Picture(words, {**numbers, **places, **times})


def _main(path: str) -> int:
    # While the input is being made: a first picture takes three times as long as the next one.
    draw(_nothing())
    data = sys.stdin.buffer.read()
    if not data:
        return 0  # There is no run to draw.
    try:
        write(Picture.unpacked(data), path)
    except (OSError, ValueError) as error:
        sys.stderr.write(str(error))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1]))
