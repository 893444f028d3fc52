"""A machine that cannot render says so, and learns by motion capture."""

import ctypes
import os
import subprocess
import sys
from pathlib import Path

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


@pytest.mark.parametrize(("before", "after"), [(None, "0"), ("2", "2")])
def test_who_has_set_threads_of_the_software_renderer_keeps_them(monkeypatch, before, after):
    monkeypatch.setenv("LP_NUM_THREADS", before or "")
    if before is None:
        monkeypatch.delenv("LP_NUM_THREADS")
    renderer.draw_in_one_thread()
    assert os.environ["LP_NUM_THREADS"] == after


LOOK = """
import resource, sys
from pathlib import Path
import numpy as np
from nico_selfmodel.systems.rendering.renderer import draw_in_one_thread
if sys.argv[1] == "one":
    draw_in_one_thread()
from nico_selfmodel.systems.closing import free_memory
from nico_selfmodel.systems.rendering.body_image import BodyImage
from tests.knowing_nico import knowing
known = knowing(0)
with BodyImage(known.before.nico.arm, known.robot.model) as image:
    for readings in known.robot.model.servos.to_encoder(np.array([np.zeros(6), np.full(6, 0.3)])):
        for side in range(2):
            image.expect(readings, known.body.mirror("mirror"), side)
    free_memory()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    print(pages * resource.getpagesize() / 1e6)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="Mesa renders in software on Linux only")
def test_a_renderer_without_threads_of_its_own_takes_a_tenth_of_a_gigabyte_less():
    def megabytes(threads):
        done = subprocess.run(
            [sys.executable, "-c", LOOK, threads], capture_output=True, text=True, check=True,
            timeout=300, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            cwd=Path(__file__).parents[2],
        )  # fmt: skip
        return float(done.stdout.split()[-1])

    assert megabytes("one") < megabytes("many") - 100.0
