"""A simulated recording that was interrupted ends as if it had not been."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import content_hash, load_dataset, save_dataset
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.recording.session import record
from nico_selfmodel.sessions.camera_scenario import RenderedNico
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.rendering.renderer import can_render
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody

from .slow_rest import slow_rest

LOSSY = replace(IMPERFECTIONS["thesis"], dropout_share=0.5)


def stopping_after(*poses):
    """Return a progress callback that stops the recording when so many poses are done."""
    left = list(poses)

    def progress(done, _total):
        if left and done == left[0]:
            del left[0]
            raise KeyboardInterrupt

    return progress


def interrupted(run, folder, *poses):
    """Run a recording that is stopped after each of some poses, until it ends."""
    progress = stopping_after(*poses)
    for _ in poses:
        with pytest.raises(KeyboardInterrupt):
            run(folder, progress)
    return run(folder, progress)


def assert_same_files(one, other):
    for name in ("dataset.yaml", "samples.csv"):
        assert (one / name).read_bytes() == (other / name).read_bytes()
    images = [sorted(p for p in folder.glob("images/*")) for folder in (one, other)]
    assert [p.name for p in images[0]] == [p.name for p in images[1]]
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(*images, strict=True))


@pytest.mark.parametrize("stops", slow_rest(map(pytest.param, [(7,), (1,), (3, 11, 19)])))
@pytest.mark.parametrize(
    "world", [IMPERFECTIONS["thesis"], LOSSY], ids=["thesis", "markers often lost"]
)
def test_under_motion_capture(tmp_path, world, stops):
    arm = ArmDescription.named("nico")
    protocol = replace(SweepProtocol.for_arm(arm), random_poses=15, circle_points=2)

    def run(folder, progress=None):
        return simulated_session(
            arm, world, protocol, "x", seed=3, session=1, folder=folder, progress=progress
        )

    whole = run(tmp_path / "whole")
    data = interrupted(run, tmp_path / "parts", *stops)
    assert content_hash(data) == content_hash(whole)
    assert_same_files(tmp_path / "whole", tmp_path / "parts")
    if world is LOSSY:
        assert max(map(int, data.extra["visits"])) > 1


@pytest.mark.slow
def test_at_a_station(tmp_path):
    def run(folder, progress=None):
        station = NicoStation(LOSSY, 5, 2)
        body = StationBody(station, station.joints, station.arm.markers, sensor=SENSOR)
        rng = np.random.default_rng(0)
        low, high = np.array([[j.lower, j.upper] for j in body.joints]).T
        plan = [("", rng.uniform(low, high)) for _ in range(6)]
        plan.insert(3, plan[2])  # where it stands already: it leaves and comes back
        return record(body, plan, "x", folder=folder, progress=progress)

    whole = run(tmp_path / "whole")
    assert content_hash(interrupted(run, tmp_path / "parts", 2, 5)) == content_hash(whole)


SENSOR = "motion-capture"


@pytest.mark.slow
def test_before_its_cameras_and_with_pictures(tmp_path):
    if not can_render():
        pytest.skip("nothing can be rendered here")

    def run(folder, stop):
        words = [sys.executable, "-c", FILMED, str(folder), str(stop)]
        done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=300)
        assert ("KeyboardInterrupt" in done.stderr) == (done.returncode != 0) == (stop > 0)

    run(tmp_path / "whole", 0)
    for stop in (3, 8, 0):
        run(tmp_path / "parts", stop)
    assert_same_files(tmp_path / "whole", tmp_path / "parts")


FILMED = """
import sys
from pathlib import Path
from nico_selfmodel.sessions.camera_scenario import RenderedNico

def progress(done, _total):
    if done == int(sys.argv[2]):
        raise KeyboardInterrupt

nico = RenderedNico("thesis", 2, ("fiducial",))
nico.record("x", 0, 4, 5, folder=Path(sys.argv[1]), keep_images=True, progress=progress)
"""
"""In processes of their own, as they are resumed: where two surfaces meet in one depth, which is
drawn first hangs on how many geometries a process has had before."""


@pytest.mark.slow
def test_before_a_mirror(tmp_path):
    if not can_render():
        pytest.skip("nothing can be rendered here")
    before = NicoBeforeMirrors(RenderedNico("thesis", 2, ("fiducial",)), {"a": DEFAULT_MIRROR})

    def run(folder, progress=None):
        return before.record("x", 0, 3, 2, best=False, folder=folder, progress=progress)

    run(tmp_path / "whole")
    interrupted(run, tmp_path / "parts", 2, 5)
    assert_same_files(tmp_path / "whole", tmp_path / "parts")


def test_a_pose_whose_pictures_are_missing_is_taken_again(tmp_path):
    """A process killed between a pose and its pictures leaves the one without the other."""
    arm = ArmDescription.named("nico")
    protocol = replace(SweepProtocol.for_arm(arm), random_poses=3, circle_points=1)
    folder = tmp_path / "x"
    simulated_session(arm, LOSSY, protocol, "x", seed=3, session=1, folder=folder)
    data = load_dataset(folder)
    save_dataset(replace(data, cameras={"images": "images/<camera><pose>.png"}), folder, force=True)
    visited = []
    simulated_session(
        *(arm, LOSSY, protocol, "x"),
        seed=3,
        session=1,
        folder=folder,
        progress=lambda done, _: visited.append(done),
    )
    assert load_dataset(folder).p_WH_measured.tolist() == data.p_WH_measured.tolist()
