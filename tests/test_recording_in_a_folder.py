"""A recording in a folder is whole at any time and goes on where it stopped."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import content_hash, load_dataset, save_dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import DataError, RobotError
from nico_selfmodel.planning.first_guess import first_guess
from nico_selfmodel.planning.plans import angles_of_commands, commands_of_angles, pose_plan
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.recording import recorded_samples
from nico_selfmodel.recording.session import record
from nico_selfmodel.systems.measurements import CameraMeasurement, Measurement
from nico_selfmodel.vision.images.image_file import read_image

JOINTS = (
    JointInfo("base", "counts", 1000.0, -400.0, 400.0),
    JointInfo("tip", "counts", 1000.0, -100.0, 300.0),
)
PLAN = pose_plan(
    JOINTS, [0.0, 50.0], [[-100.0, 100.0], [0.0, 100.0]], 4, [[10.0, 20.0], [30.0, 40.0]]
)


class Body:
    joints, markers = JOINTS, ("hand",)

    def __init__(self, fails_at=None, unobservable_at=(), images=False):
        self.visits, self.fails_at, self.unobservable_at, self.images = (
            [],
            fails_at,
            unobservable_at,
            images,
        )

    def move_and_measure(self, command):
        if self.fails_at is not None and len(self.visits) == self.fails_at:
            raise RobotError("the cable is loose")
        self.visits.append(np.asarray(command))
        seen = tuple(command) not in self.unobservable_at
        pixels = np.array([*command, *command]) if seen else np.full(4, np.nan)
        if not self.images:
            return Measurement(np.asarray(command), {"hand": pixels[:3] * 1e-3 if seen else None})
        pictures = tuple(np.full((4, 6, 3), 10 * len(self.visits), np.uint8) for _ in range(2))
        return CameraMeasurement(
            np.asarray(command), {"hand": None}, {"hand": np.abs(pixels)}, pictures
        )


def test_what_is_on_disk_is_what_is_returned(tmp_path):
    data = record(Body(), PLAN, "trial", folder=tmp_path / "out")
    assert content_hash(load_dataset(tmp_path / "out")) == content_hash(data)
    assert data.extra["pose"] == tuple(str(i + 1) for i in range(len(PLAN)))


def test_an_interrupted_recording_goes_on_and_loses_nothing(tmp_path):
    whole = record(Body(), PLAN, "trial", folder=tmp_path / "whole")
    with pytest.raises(RobotError) as failure:
        record(Body(fails_at=3), PLAN, "trial", folder=tmp_path / "out")
    kept = load_dataset(tmp_path / "out")
    assert len(kept) == len(failure.value.partial) == 3
    second = Body()
    data = record(second, PLAN, "trial", folder=tmp_path / "out")
    assert len(second.visits) == len(PLAN) - 3
    # Nobody watched the joints while it stood: from which side they then came is not known.
    assert not data.approach[3].any()
    known = data.approach != 0
    assert known.any()
    assert (data.approach[known] == whole.approach[known]).all()
    same = replace(data, approach=whole.approach)
    assert content_hash(same) == content_hash(whole)


def test_poses_that_were_not_seen_are_tried_again(tmp_path):
    unobservable = tuple(PLAN[2][1])
    data = record(
        Body(unobservable_at=[unobservable]), PLAN, "trial", folder=tmp_path / "out", until_seen=2
    )
    assert "3" not in data.extra["pose"]
    second = Body()
    data = record(second, PLAN, "trial", folder=tmp_path / "out")
    assert [tuple(v) for v in second.visits] == [unobservable]
    assert data.extra["pose"] == tuple(str(i + 1) for i in range(len(PLAN)))


def test_a_recording_of_other_poses_or_another_body_is_not_gone_on_with(tmp_path):
    record(Body(), PLAN[:4], "trial", folder=tmp_path / "out")
    others = [(label, command + 50.0) for label, command in PLAN]
    with pytest.raises(DataError, match="other poses"):
        record(Body(), others, "trial", folder=tmp_path / "out")
    stranger = Body()
    stranger.joints = (JOINTS[0], JointInfo("wrist", "counts", 1000.0, -100.0, 300.0))
    with pytest.raises(DataError, match="another body"):
        record(stranger, PLAN, "trial", folder=tmp_path / "out")
    save_dataset(record(Body(), PLAN, "plain"), tmp_path / "plain")
    with pytest.raises(DataError, match="cannot be resumed"):
        record(Body(), PLAN, "trial", folder=tmp_path / "plain")


@pytest.mark.parametrize(
    ("column", "cell", "message"),
    [
        *[("pose", cell, "a whole number from 1 was expected") for cell in ("x", "1.5", "0", "-3")],
        ("pose", "99", "other poses"),
        ("pose", "1", "pose 1 does not have one row for each of hand"),
        *[("visits", cell, "a whole number from 1 was expected") for cell in ("", "-1", "1e9")],
    ],
)
def test_a_recording_that_somebody_edited_is_refused_by_its_place(tmp_path, column, cell, message):
    out = tmp_path / "out"
    record(Body(), PLAN[:2], "trial", folder=out)
    data = load_dataset(out)
    save_dataset(replace(data, extra={**data.extra, column: ("1", cell)}), out, force=True)
    with pytest.raises(DataError, match=message):
        record(Body(), PLAN, "trial", folder=out)


def test_a_full_disk_is_an_error_and_what_was_recorded_stays(tmp_path, monkeypatch):
    saved, save = [], save_dataset

    def save_until_full(self, folder, force=False):
        if len(saved) == 2:
            raise DataError(f"{folder}: cannot be written: No space left on device")
        saved.append(folder)
        save(self, folder, force)

    monkeypatch.setattr(recorded_samples, "save_dataset", save_until_full)
    monkeypatch.setattr(recorded_samples, "_WRITING", 1.0)
    with pytest.raises(DataError, match="No space left on device; the 2 poses") as failure:
        record(Body(), PLAN, "trial", folder=tmp_path / "out")
    assert len(load_dataset(tmp_path / "out")) == len(failure.value.partial) == 2


def test_poses_that_come_fast_are_written_together_and_none_is_lost(tmp_path, monkeypatch):
    saved, save = [], save_dataset

    def counted(self, folder, force=False):
        saved.append(len(self))
        save(self, folder, force)

    monkeypatch.setattr(recorded_samples, "save_dataset", counted)
    plan = [("", np.array([float(i), 0.0])) for i in range(200)]
    with pytest.raises(RobotError) as failure:
        record(Body(fails_at=190), plan, "trial", folder=tmp_path / "out")
    assert len(load_dataset(tmp_path / "out")) == len(failure.value.partial) == 190
    assert len(saved) < 50


def test_a_body_that_is_interrupted_leaves_every_pose(tmp_path):
    class Interrupted(Body):
        def move_and_measure(self, command):
            if len(self.visits) == 5:
                raise KeyboardInterrupt
            return super().move_and_measure(command)

    with pytest.raises(KeyboardInterrupt):
        record(Interrupted(), PLAN, "trial", folder=tmp_path / "out")
    assert len(load_dataset(tmp_path / "out")) == 5


def test_pictures_are_kept_beside_the_samples(tmp_path):
    data = record(Body(images=True), PLAN, "trial", folder=tmp_path / "out", image_size=(600, 400))
    names = sorted(path.name for path in (tmp_path / "out" / "images").iterdir())
    assert len(names) == 2 * len(PLAN)
    assert names[0] == "left0001.png"
    assert (read_image(tmp_path / "out" / "images" / "right0003.png") == 30).all()
    loaded = load_dataset(tmp_path / "out")
    assert loaded.cameras == {"images": "images/<camera><pose>.png"}
    assert loaded.image_size == (600, 400)
    assert np.array_equal(loaded.pixels, data.pixels)


def test_enough_free_poses_end_a_recording():
    plan = [("", np.array([float(i), 0.0])) for i in range(20)]
    body, done = Body(), []
    data = record(body, plan, "trial", enough=7, progress=lambda *step: done.append(step))
    assert len(data) == len(body.visits) == 7
    assert done[-1] == (20, 20)


def test_nothing_seen_leaves_nothing_behind(tmp_path):
    everywhere = [tuple(command) for _, command in PLAN]
    with pytest.raises(DataError):
        record(
            Body(unobservable_at=everywhere), PLAN, "trial", folder=tmp_path / "out", until_seen=1
        )
    assert not (tmp_path / "out").exists()


def test_a_plan_turns_one_joint_at_a_time_and_spends_the_poses_evenly():
    plan = pose_plan(JOINTS, [0.0, 50.0], [[-100.0, 100.0], [0.0, 100.0]], 5, [], 2)
    assert [label for label, _ in plan] == ["home"] * 2 + ["base"] * 3 + ["tip"] * 2
    assert [command[0] for label, command in plan if label == "base"] == [-100.0, 0.0, 100.0]
    assert all(command[1] == 50.0 for label, command in plan if label == "base")
    assert [label for label, _ in pose_plan(JOINTS, [0, 0], np.zeros((2, 2)), 0, [[1, 2]])] == [""]


def test_angles_become_shares_of_the_range_between_the_stops():
    commands = commands_of_angles(JOINTS, [-1.0, 0.0], [1.0, 2.0], [[0.0, 0.5], [-1.0, 2.0]])
    assert commands.tolist() == [[0.0, 0.0], [-400.0, 300.0]]
    with pytest.raises(ValueError, match="without stops"):
        commands_of_angles([JointInfo("base", "rad")], [-1.0], [1.0], [[0.0]])


@pytest.mark.parametrize("sign", [1, -1])
def test_angles_and_commands_stand_for_each_other_as_the_first_guess_has_it(sign):
    arm = ArmDescription.named("nico")
    stops = np.sort(sign * np.degrees([arm.lower, arm.upper]) + 5.0, axis=0).T
    joints = [
        JointInfo(name, "deg", None, *ends, sign=sign if k % 2 else 1)
        for k, (name, ends) in enumerate(zip(arm.joints, stops, strict=True))
    ]
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (5, len(joints)))
    commands = commands_of_angles(joints, arm.lower, arm.upper, q)
    guessed = first_guess(arm, None, joints).servos.to_encoder(q)
    assert np.abs(commands - guessed).max() < 1e-9
    assert np.abs(angles_of_commands(joints, arm.lower, arm.upper, commands) - q).max() < 1e-12
