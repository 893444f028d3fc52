"""Recordings of bodies whose cameras look into mirrors, in memory and on disk."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.body_folder import (
    body_content_hash,
    load_body_dataset,
    save_body_dataset,
)
from nico_selfmodel.dataset.body.joining import joined
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.errors import DataError


@pytest.fixture
def recording():
    """A marker seen by a camera directly and in two mirrors, and by a tracker."""
    values = np.full((4, 6), np.nan)
    values[:3, :2], values[3, :3] = [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], 0.1
    table = ObservationTable(
        [0, 0, 1, 1], [0, 0, 0, 1], [0] * 4, [-1] * 4, values, ["", "hall", "door", ""]
    )
    return BodyDataset(
        "before mirrors",
        (LinkJoint("neck"),),
        (MarkerInfo("hand", "neck"),),
        (SensorInfo("left", "camera", "neck"), SensorInfo("tracker", "points")),
        [1, 2],
        np.zeros((2, 1)),
        table,
    )


def test_mirrors_of_a_recording_survive_the_round_trip(recording, tmp_path):
    save_body_dataset(recording, tmp_path / "there")
    again = load_body_dataset(tmp_path / "there")
    assert again.mirrors == ("door", "hall")
    assert again.observations.mirror.tolist() == ["", "hall", "door", ""]
    assert body_content_hash(again) == body_content_hash(recording)
    assert recording.select([True, False]).mirrors == ("hall",)
    assert joined(recording, recording, "both").observations.mirror.tolist()[4:] == [
        "", "hall", "door", "",
    ]  # fmt: skip


def test_a_recording_without_mirrors_has_no_such_column(recording, tmp_path):
    direct = recording.of_rows(recording.observations.mirror == "")
    save_body_dataset(direct, tmp_path / "there")
    assert "mirror" not in (tmp_path / "there" / "observations.csv").read_text("utf-8")
    assert load_body_dataset(tmp_path / "there").mirrors == ()


def test_a_tracker_does_not_look_into_mirrors(recording, tmp_path):
    with pytest.raises(DataError, match=r"'tracker' .points. names mirror 'hall': only a camera"):
        replace(recording, observations=replace(recording.observations, mirror=["hall"] * 4))
    save_body_dataset(recording, tmp_path / "there")
    file = tmp_path / "there" / "observations.csv"
    file.write_text(file.read_text("utf-8").replace("tracker,hand,", "tracker,hand,hall"), "utf-8")
    with pytest.raises(DataError, match=r"there: observation 3 of sensor 'tracker'"):
        load_body_dataset(tmp_path / "there")
