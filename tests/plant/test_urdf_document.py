import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import rotation_from_rpy
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.plant.urdf_document import (
    append_frame_link,
    child,
    document_text,
    origin_of,
    read_document,
    robot_element,
    set_origin,
)


@pytest.fixture
def read(tmp_path):
    def document(text: str):
        path = tmp_path / "robot.urdf"
        path.write_text(text)
        return read_document(path)

    return document


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot name='a&b;'/>", "not valid XML: undefined entity"),
        ("<robot name='a' name='b'/>", "not valid XML: duplicate attribute"),
        ("<sdf/>", "root element must be <robot>"),
        ("<robot><link><origin xyz='1 2'/></link></robot>", "expected three numbers .* got '1 2'"),
    ],
)
def test_what_is_no_urdf_is_refused(read, text, message):
    with pytest.raises(ModelError, match=message):
        origin_of(child(robot_element(read(text)), "link"))


def test_a_document_is_written_as_it_was_read(read):
    robot = '<robot name="r">\n  <d:x b="1" a="2"/><!--c-->\n</robot>'
    text = f'<?xml version="1.0"?>\n<!-- a -->\n{robot}\n'
    assert document_text(read(text)) == text
    # What XML forbids in a comment is put right, the rest is left alone.
    assert "<!-- ~~ a ~ -->" in document_text(read("<robot><!-- -- a - --><link/></robot>"))


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2, -np.pi / 2, np.pi / 2 - 3e-11, np.pi / 2 - 1e-7])
def test_poses_are_read_back_to_rounding_up_to_gimbal_lock(read, pitch):
    document = read("<robot><link/></robot>")
    link = child(robot_element(document), "link")
    pose = transform(rotation_from_rpy(0.4, pitch, -1.1), [1.0 / 3.0, -2e-17, 5.0])
    set_origin(link, pose)
    np.testing.assert_allclose(origin_of(link), pose, rtol=0, atol=4e-15)


def test_what_is_added_stands_on_lines_of_its_own(read):
    document = read("<robot><link name='a'/></robot>")
    append_frame_link(robot_element(document), "f", "a", np.eye(4))
    assert document_text(document).splitlines() == [
        '<?xml version="1.0"?>',
        "<robot>",
        '  <link name="a"/>',
        '  <link name="f"/>',
        '  <joint name="f_mount" type="fixed"><parent link="a"/><child link="f"/></joint>',
        "</robot>",
    ]
