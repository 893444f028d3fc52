"""A machine that cannot render says so, and learns by motion capture."""

import ctypes

import pytest

from nico_selfmodel.errors import RobotError
from nico_selfmodel.systems.rendering import renderer


@pytest.fixture
def unobservable(monkeypatch):
    """Hide the library that rendering needs."""

    def missing(name, *_, **__):
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", missing)
    monkeypatch.setattr(renderer.sys, "platform", "linux")


@pytest.mark.usefixtures("unobservable")
def test_rendering_is_refused_with_what_to_install():
    assert not renderer.can_render()
    with pytest.raises(RobotError, match=r"libEGL.*install Debian's libegl1"):
        renderer.check_renderer()


@pytest.mark.slow
def test_learn_takes_motion_capture_where_nothing_can_be_rendered(tmp_path, command, monkeypatch):
    monkeypatch.setattr(renderer, "can_render", lambda: False)
    done = command("learn", "--out", tmp_path / "arm", "--random", 60)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "motion capture watches instead of the cameras" in done.stderr
    assert (tmp_path / "arm" / "nico_learned.urdf").is_file()
