"""What bends, in a report: what was tried, what stayed, and how far it moves the hand."""

from collections.abc import Mapping
from typing import Any

from nico_selfmodel.estimation.bending.what_bends import WORDS, At
from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.viz.figures.bending_plots import bent_hands
from nico_selfmodel.viz.reports import parts
from nico_selfmodel.viz.reports.tables import Cell, Table, number_cell


def bending_section(
    bends: Bending | None, at: At, document: Mapping[str, Any]
) -> list[parts.Section]:
    """Return the section; nothing where nothing was asked.

    Args:
        at: Where tracked points are.
        document: `estimation.judging.to_json` of it; the numbers shown are these.
    """
    bending = document["bending"]
    if bending is None:
        return []
    words = (
        "Effects are tried one after the other, and kept only where poses that were left out gain "
        "by more than 1 % and a standard error, and twice the logarithm of the evidence rises by "
        "more than 10. Errors are geometric means over poses, each predicted without its fold."
    )
    section = parts.section(
        "What bends",
        None if bending["effects"] else parts.Text(_not_claimed(bending)),
        parts.drawing("How bending moves the hand", bent_hands(bends, at, _learned(bending))),
        parts.numbers(_ladder(bending), "cards"),
        parts.numbers(_joints(bending)),
        parts.hint(words),
        id="bending",
    )
    return [section]


def _learned(bending: Mapping[str, Any]) -> list[str]:
    """Return the effects that stayed; where none did, those that were learned and not claimed."""
    return list(bending["effects"] or bending["hand_mm"])


def _not_claimed(bending: Mapping[str, Any]) -> str:
    """Say what became of effects of which none stayed."""
    if not bending["hand_mm"]:
        return "Nothing that these data tell: it is rigid."
    found = ", ".join(WORDS[effect] for effect in bending["hand_mm"])
    return (
        f"The data tell that {found}, which other errors hide in unseen poses: learned, and its "
        "uncertainty counted, but not claimed."
    )


def _joints(bending: Mapping[str, Any]) -> Table | None:
    """Return how far each effect turns each joint, and moves the hand."""
    effects = [effect for effect in _learned(bending) if effect in bending["joints_mrad"]]
    if not effects:
        return None
    hand, turns = bending["hand_mm"], bending["joints_mrad"]
    rows = [
        (f"hand, {words} [mm]", tuple(number_cell(hand[effect][key], 3) for effect in effects))
        for words, key in (("mean", "mean"), ("most", "max"))
    ]
    # Bearings tilt, and gears are read: neither turns a joint.
    turning = [effect for effect in effects if any(turns[effect].values())]
    rows += [
        (
            f"{joint} [mrad]",
            tuple(number_cell(turns[e][joint] if e in turning else None, 2) for e in effects),
        )
        for joint in (turns[turning[0]] if turning else ())
    ]
    return Table(("what moves", *(WORDS[effect] for effect in effects)), tuple(rows))


def _ladder(bending: Mapping[str, Any]) -> Table:
    """Return what was tried, in its order."""
    unit = "mm" if "unseen_mm" in bending else "px"
    rows = tuple(
        (
            f"{step['effect'].replace('_', ' ')}: {'kept' if step['kept'] else step['reason']}",
            (
                number_cell(step[f"before_{unit}"], 3),
                number_cell(step[f"after_{unit}"], 3),
                Cell(f"{100 * step['gain']:z.1f} %", f"{100 * step['gain_sigma']:.1f}"),
                number_cell(step["evidence"], 1),
            ),
        )
        for step in bending["tried"]
    )
    headings = ("tried", f"unseen before [{unit}]", f"after [{unit}]", "gain", "2 log evidence")
    return Table(headings, rows)
