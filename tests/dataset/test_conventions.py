"""The recording that CONVENTIONS shows is one."""

import re

import numpy as np

from nico_selfmodel.dataset.body.body_folder import load_body_dataset


def test_the_recording_of_the_conventions_is_read_as_it_stands(project_root, tmp_path):
    text = (project_root / "CONVENTIONS.md").read_text(encoding="utf-8")
    section = text.split("### Recording of any body")[1]
    (head,) = re.findall(r"```yaml\n(.*?)```", section.split("### ")[0], re.DOTALL)
    poses, observations = re.findall(r"```csv\n(.*?)```", section.split("### ")[0], re.DOTALL)
    for name, content in (
        ("dataset.yaml", head),
        ("poses.csv", poses),
        ("observations.csv", observations),
    ):
        (tmp_path / name).write_text(content, encoding="utf-8")
    read = load_body_dataset(tmp_path)
    assert [(joint.name, joint.parent) for joint in read.joints] == [
        ("shoulder", "world"),
        ("elbow", "shoulder"),
    ]
    assert [marker.name for marker in read.markers] == ["tag0", "ball"]
    assert [sensor.name for sensor in read.sensors] == ["camera1", "tracker"]
    np.testing.assert_array_equal(read.readings, [[12.5, 803.0]])
