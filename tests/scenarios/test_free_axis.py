from io import StringIO

from rich.console import Console

from scenarios.free_axis import FreeAxisOptions, run


def test_a_free_axis_reaches_more_and_all_tight() -> None:
    screen = StringIO()
    assert run(FreeAxisOptions(n=12), Console(file=screen, width=200)) == 0
    fixed, free, tight = screen.getvalue().splitlines()
    counts = [int(line.split(": ")[1].split(" of ")[0]) for line in (fixed, free, tight)]
    assert counts[0] <= counts[1] == counts[2]
