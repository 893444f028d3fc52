"""The table of joints in urdf/README.md is a copy: it must say what the robot is."""

import math
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

URDF_FOLDER = Path(__file__).resolve().parents[2] / "urdf"


def test_the_table_of_joints_in_the_readme_is_the_robot() -> None:
    xml_root = ElementTree.parse(URDF_FOLDER / "nico.urdf").getroot()
    written = re.findall(r"^\| `(\w+)` \|(.*)\|$", (URDF_FOLDER / "README.md").read_text(), re.M)
    rows = {name: [cell.strip(" `") for cell in cells.split("|")] for name, cells in written}

    assert rows.keys() == {
        joint.get("name") for joint in xml_root.findall("joint[@type='revolute']")
    }
    for name, (parent, child, origin, axis, lower, upper, speed, torque) in rows.items():
        joint = xml_root.find(f"joint[@name='{name}']")
        limit = joint.find("limit").attrib
        direction = np.zeros(3)
        direction["xyz".index(axis[1])] = float(f"{axis[0]}1")
        xyz_mm = 1000.0 * np.array(joint.find("origin").get("xyz").split(), float)
        assert (joint.find("parent").get("link"), joint.find("child").get("link")) == (
            parent,
            child,
        )
        np.testing.assert_allclose(xyz_mm, np.array(origin.split(","), float), atol=1e-9)
        np.testing.assert_array_equal(
            np.array(joint.find("axis").get("xyz").split(), float), direction
        )
        assert math.degrees(float(limit["lower"])) == pytest.approx(float(lower), abs=0.01)
        assert math.degrees(float(limit["upper"])) == pytest.approx(float(upper), abs=0.01)
        assert (float(limit["velocity"]), float(limit["effort"])) == (float(speed), float(torque))
