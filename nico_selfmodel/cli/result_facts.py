"""What only some results tell, read from the keys of their `result.json`."""

from collections.abc import Iterator, Mapping
from typing import Any

from nico_selfmodel.names import called

_DERIVED = ("baseline", "link.upper", "link.lower")


def derived_rows(parameters: Mapping[str, Any]) -> list[str]:
    """Return the names of lengths that follow from what was estimated."""
    return [name for name in _DERIVED if name in parameters and not parameters[name]["free"]]


def fact_rows(document: Mapping[str, Any]) -> list[list[str]]:
    """Return what a result tells besides errors and parameters, in words and numbers.

    Args:
        document: What is in a `result.json`.
    """
    found = (_noise, _workspace, _known, _boards, _mirrors, _touches, _tool, _zeros)
    return [[name, value] for of in found for name, value in of(document)]


def _noise(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if "noise_known_to" in document:
        from nico_selfmodel.estimation.body.body_result import noise_words

        tracker, joints = noise_words(document)
        yield "noise of the tracker", tracker
        yield "noise of a joint, standard deviation", joints
    if "scale_from" in document:
        yield "scale held by", document["scale_from"] or "nothing"
    off = document.get("description_off")
    if off:
        said = "as the data tell" if off["learned"] else "as was stated"
        sigmas = f"{off['turn_sigma_deg']:.2g} deg, {off['shift_sigma_mm']:.2g} mm"
        yield "each part of a described frame is off by", f"{sigmas} (standard deviation, {said})"


def _workspace(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    work = document.get("workspace")
    if work:
        yield "irreducible error of the hand", f"{work['mechanics_mm']['mean']:.2f} mm"
        yield "reducible by more data", f"{work['learned_mm']['mean']:.2f} mm"


def _known(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    before = document.get("before")
    if document["method"] in ("camera", "stereo", "cameras") and before and before.get("pixels"):
        now = document[before["on"]]["pixels"]["rms"]
        rms = f"{before['pixels']['rms']:.3f} px rms on the same boards, now {now:.3f}"
        yield f"as {before['model']} had them", rms


def _boards(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    boards = document.get("boards")
    if not boards:
        return
    which = "held-out boards" if boards["held_out"] else "boards learned from"
    for when in ("before", "after"):
        found = boards[when]
        if found is not None:
            edge, scale = found["edge_mm"]["sd"], 100.0 * (found["scale"]["mean"] - 1.0)
            yield (
                f"{found['boards']} {which}, {when}",
                f"edges {edge:.2f} mm (SD), scale {scale:+z.2f} %, corners "
                f"{found['position_mm']['mean']:.2f} mm",
            )


def _mirrors(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    mirrors = document.get("mirrors") or document.get("mirror", {}).get("mirrors", {})
    for name, entry in mirrors.items():
        test = entry["flatness"]
        flat = "not tested for flatness" if test is None else "flat" if test["flat"] else "not flat"
        start = entry.get("distance_from", "the left camera")
        sigma = entry["normal_sigma_deg"]
        known = "normal not known" if sigma is None else f"normal to {sigma:.2f} deg"
        yield (
            called("mirror", name),
            f"{entry['poses']} poses, {entry['distance_mm']:.0f} mm from {start}, {known}, {flat}",
        )


def _touches(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, entry in document.get("touches", {}).items():
        held_out = ""
        if "test_n" in entry:
            held_out = f", {entry['test_rms_mm']:.3g} mm in {entry['test_n']} held out"
        yield f"{name} is missed by", f"{entry['rms_mm']:.3g} mm rms in {entry['n']}{held_out}"


def _tool(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    reach = document.get("reach_mm")
    if reach:
        place = "where it was" if document["known"] else "the hand's point"
        place = reach.get("from", place)
        yield (
            f"tip of {document['tool']}",
            (f"{reach['value']:.1f} +- {reach['sigma']:.1f} mm from {place}"),
        )


def _zeros(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for key, unit, factor in (("shift_deg", "deg", 57.29578), ("shift_mm", "mm", 1e3)):
        for joint, shift in document.get(key, {}).items():
            parts = (f"{joint}.{part}" for part in ("theta_offset", "rz", "z"))
            known = [document["parameters"][name] for name in parts if name in
                     document["parameters"]]  # fmt: skip
            sigma = f"+- {factor * known[0]['sigma']:.2f} {unit}" if known else "held"
            yield f"zero of {joint}", f"at one reading moved by {shift:+z.2f} {unit}, {sigma}"
