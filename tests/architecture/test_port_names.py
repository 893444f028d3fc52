"""Ports of systems: one name and one unit for one thing, as CONVENTIONS tells."""

import ast
import re

ROW = re.compile(r"^\s*\| (`[^|]+`) \| (in|out) \| (.+) \|$", re.MULTILINE)
UNIT = re.compile(r"\[([^\]]+)\]")
ENCODER_UNITS = {"counts", "encoder units"}


def documented_ports(sources):
    """Yield (place, name, direction, what it says) of every port in a table of `systems`."""
    for source in sources:
        if source.room != "systems":
            continue
        for node in source.nodes:
            text = ast.get_docstring(node) if isinstance(node, ast.ClassDef) else None
            for names, direction, words in ROW.findall(text or ""):
                for name in re.findall(r"`(\w+)`", names):
                    yield f"{source.path}:{node.name}", name, direction, words


def test_a_name_of_a_port_has_one_unit_everywhere(sources):
    units = {}
    for _, name, _, words in documented_ports(sources):
        unit = UNIT.findall(words)
        if unit:
            units.setdefault(name, set()).add("encoder" if unit[-1] in ENCODER_UNITS else unit[-1])
    assert {"encoders", "encoders_commanded", "p_WH_measured", "pixels", "q_measured"} <= set(units)
    assert {name: found for name, found in units.items() if len(found) > 1} == {}


def test_ports_in_metres_radians_pixels_and_encoder_units_are_named_in_the_conventions(
    sources, project_root
):
    section = (project_root / "CONVENTIONS.md").read_text(encoding="utf-8")
    section = section.split("## Ports of systems")[1].split("\n## ")[0]
    told = set(re.findall(r"`(\w+)`", section))
    untold = {
        (place, name)
        for place, name, _, words in documented_ports(sources)
        if set(UNIT.findall(words)) & {"m", "rad", "px", *ENCODER_UNITS}
    } - {(place, name) for place, name, *_ in documented_ports(sources) if name in told}
    assert untold == set()
