"""The comparison of kept and measured figures as a page for people (Markdown)."""

from collections.abc import Mapping, Sequence

from scenarios.reproduce.comparison import BAR, FLOOR, Agreement, Compared

_HEAD = ("| figure | kept | measured | difference | verdict |", "|---|--:|--:|--:|---|")


def comparison_page(
    compared: Sequence[Compared],
    kept_on: Mapping[str, str],
    measured_on: Mapping[str, str],
    notes: Sequence[str],
) -> str:
    """Both columns with the verdicts, and what they mean.

    Args:
        compared: The figures.
        kept_on: Machine and versions that gave the kept figures, by name.
        measured_on: Those that gave the measured ones.
        notes: Further paragraphs, above the table.
    """
    other = [
        name for name in _all(kept_on, measured_on) if kept_on.get(name) != measured_on.get(name)
    ]
    judged, told = _split(compared)
    lines = ["# Reproduced?", "", f"**{outcome(compared)}**", ""]
    for paragraph in (*notes, _bar(other)):
        lines += [paragraph, ""]
    lines += [*_HEAD, *(f"| {row(entry)} |" for entry in judged), ""]
    lines += [
        "## Told, not judged",
        "",
        "How fast and how busy the machine is, not what the robot did: these figures must be "
        "there, whatever they are.",
        "",
        *_HEAD,
        *(f"| {row(entry)} |" for entry in told),
        "",
    ]
    lines += ["## Machines", "", "| | kept | measured |", "|---|---|---|"]
    for name in _all(kept_on, measured_on):
        lines.append(f"| {name} | {kept_on.get(name, '')} | {measured_on.get(name, '')} |")
    return "\n".join(lines)


def outcome(compared: Sequence[Compared]) -> str:
    """The answer in one sentence."""
    verdicts = [entry.agreement for entry in _split(compared)[0]]
    bad = sum(not verdict.good for verdict in verdicts)
    if bad:
        return f"No: {bad} of {len(verdicts)} figures were not reproduced."
    identical = verdicts.count(Agreement.IDENTICAL)
    if identical == len(verdicts):
        return f"Yes: all {identical} figures are identical to the bit."
    return f"Yes: {identical} of {len(verdicts)} figures are identical, the others within the bar."


def row(entry: Compared) -> str:
    """The cells of one figure, without the outer bars."""
    kept, measured = (
        "none" if value is None else f"{value:.8g}" for value in (entry.kept, entry.measured)
    )
    if entry.difference is None:
        change = "none"
    else:
        change = f"{100 * entry.difference:+.2g} %" if entry.difference else "0"
    return " | ".join([entry.name, kept, measured, change, entry.agreement.value])


def _bar(other: Sequence[str]) -> str:
    bar = (
        f"The bar is {100 * BAR:g} % of the kept figure; up to {FLOOR:g}, in the unit of the "
        "figure, counts as rounding. "
    )
    if not other:
        return bar + (
            "Kept and measured figures are from the same kind of machine with the same versions: "
            "here nothing but the same bits will do."
        )
    return bar + (
        f"The kept figures are from elsewhere (another: {', '.join(other)}). Another processor "
        "or library may round and sum in another order: the last bits may differ, and contacts "
        "and iterations carry that on. The bar is for this."
    )


def _split(compared: Sequence[Compared]) -> tuple[list[Compared], list[Compared]]:
    told = [entry for entry in compared if entry.agreement is Agreement.UNJUDGED]
    return [entry for entry in compared if entry.agreement is not Agreement.UNJUDGED], told


def _all(*machines: Mapping[str, str]) -> list[str]:
    return list(dict.fromkeys(name for machine in machines for name in machine))
