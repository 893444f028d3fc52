"""Jobs in other processes: what they return comes back as it was."""

import os
import pickle
import signal
import subprocess
import sys
import time
from types import MappingProxyType

import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.experiments.mirror_test.stages import MirrorTest
from nico_selfmodel.experiments.mirror_test.structure import StructureStage
from nico_selfmodel.parallel import Workers

from .learned_ball import ball_body


def test_read_only_mappings_come_back_read_only():
    back = pickle.loads(pickle.dumps(MappingProxyType({"a": 1})))
    assert back == {"a": 1}
    assert isinstance(back, MappingProxyType)


def test_what_robots_learned_comes_back_from_their_process():
    body = ball_body("palm", "fore")
    stage = StructureStage((), 2, (), MappingProxyType({7: body}))
    back = pickle.loads(pickle.dumps(MirrorTest(None, structure=stage)))
    assert back.structure.shapes[7].links.keys() == body.links.keys()


def test_jobs_are_done_in_the_order_of_their_tasks_whoever_does_them():
    tasks = [MappingProxyType({"a": k}) for k in range(3)]
    for count in (1, 2):
        found = Workers(count).map(dict, tasks)
        assert found == [{"a": 0}, {"a": 1}, {"a": 2}]


_SLEEP = """
import os, pathlib, sys, time
from nico_selfmodel.parallel import Workers
def sleep(file):
    pathlib.Path(file).write_text(str(os.getpid()))
    time.sleep(60.0)
if __name__ == "__main__":
    Workers(2).map(sleep, sys.argv[1:])
"""


def die(_):
    os.kill(os.getpid(), signal.SIGKILL)


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def wait_until(holds):
    end = time.monotonic() + 30.0
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_processes_end_with_the_one_that_started_them(tmp_path, stop):
    script = tmp_path / "script.py"
    script.write_text(_SLEEP)
    files = [tmp_path / "a", tmp_path / "b"]
    command = [sys.executable, script, *files]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as running:
        wait_until(lambda: all(file.is_file() and file.read_text() for file in files))
        running.send_signal(stop)
        assert running.wait(20.0) != 0
    wait_until(lambda: not any(alive(int(file.read_text())) for file in files))


@pytest.mark.slow
def test_a_process_that_is_killed_is_told_as_one_that_lacks_memory():
    with pytest.raises(ChildProcessError, match="memory runs out: take fewer --processes"):
        Workers(2).map(die, [0, 1])


def sleep_or_fail(seconds):
    if not seconds:
        raise DataError("nothing was seen")
    time.sleep(seconds)


@pytest.mark.slow
def test_an_error_in_one_process_ends_the_others_at_once():
    began = time.monotonic()
    with pytest.raises(DataError, match="nothing was seen"):
        Workers(2).map(sleep_or_fail, [120.0, 0.0])
    assert time.monotonic() - began < 60.0
