"""Commands and readings over time, in memory and on disk."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.motion.motion_folder import load_motion, save_motion
from nico_selfmodel.errors import DataError

from ..simulated_steps import SERVOS, steps_recorded


@pytest.fixture(scope="module")
def motion():
    return steps_recorded(SERVOS[:2], count=2, period=0.1)


def test_a_recording_of_motion_survives_the_round_trip(motion, tmp_path):
    motion = replace(motion, source="a test")
    save_motion(motion, tmp_path / "steps")
    found = load_motion(tmp_path / "steps")
    assert found.content_hash == motion.content_hash
    assert (found.name, found.source, found.joints) == (motion.name, "a test", motion.joints)
    assert np.array_equal(found.encoders, motion.encoders, equal_nan=True)
    with pytest.raises(FileExistsError):
        save_motion(motion, tmp_path / "steps")
    save_motion(motion, tmp_path / "steps", force=True)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("time_s", "time"), "time_s"),
        (lambda text: text.replace("command.elbow", "command.knee"), "command.elbow"),
        (lambda text: text + text.splitlines()[3] + "\n", "times must rise"),
        (lambda text: text.replace("0.0", "zero", 1), "zero"),
    ],
)
def test_a_table_that_cannot_be_is_named_with_its_file(motion, tmp_path, change, words):
    folder = tmp_path / "steps"
    save_motion(motion, folder)
    table = folder / "motion.csv"
    table.write_text(change(table.read_text()))
    with pytest.raises(DataError, match=words) as raised:
        load_motion(folder)
    assert "motion.csv" in str(raised.value)


def test_another_folder_and_another_format_are_named(motion, tmp_path):
    with pytest.raises(DataError, match=r"motion\.csv"):
        load_motion(tmp_path)
    folder = tmp_path / "steps"
    save_motion(motion, folder)
    head = folder / "dataset.yaml"
    head.write_text(head.read_text().replace("nico-motion/1", "nico-dataset/1"))
    with pytest.raises(DataError, match="nico-motion/1"):
        load_motion(folder)


def test_numbers_that_do_not_belong_together_are_refused(motion):
    with pytest.raises(ValueError, match="shape"):
        replace(motion, encoders=motion.encoders[:5])
    with pytest.raises(ValueError, match="finite"):
        replace(motion, commanded=motion.commanded * np.nan)
    with pytest.raises(ValueError, match="different names"):
        replace(motion, joints=motion.joints[:1] * 2)
