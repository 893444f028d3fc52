"""Estimation runs on one BLAS thread, and gives the others back."""

import subprocess
import sys
import threading

import numpy as np  # noqa: F401  its BLAS is asked
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from nico_selfmodel.blas_threads import on_one_blas_thread


def threads():
    """Threads of numpy's BLAS; another library's, loaded since, is none that estimates."""
    blas = [one for one in threadpool_info() if one["user_api"] == "blas"]
    return {one["num_threads"] for one in blas if "numpy" in one["filepath"]}


@on_one_blas_thread
def asked(then=lambda: None):
    inside = threads()
    then()
    return inside


def fail():
    raise ValueError("so")


def test_a_call_runs_on_one_thread_and_gives_the_others_back():
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        assert asked() == {1}
        assert threads() == before


def test_a_call_that_fails_gives_them_back_too():
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with pytest.raises(ValueError, match="so"):
            asked(fail)
        assert threads() == before


def test_calls_that_overlap_give_them_back_when_they_end():
    before, entered, go = threads(), threading.Event(), threading.Event()

    def wait():
        entered.set()
        go.wait(10.0)

    other = threading.Thread(target=asked, args=(wait,))
    other.start()
    assert entered.wait(10.0)
    assert asked() == {1}
    go.set()
    other.join()
    assert threads() == before


def test_who_sets_nothing_learns_on_one_thread():
    code = """
import numpy as np
from threadpoolctl import threadpool_info
from nico_selfmodel.estimation.arm import kinematics
found = []
def looked(*args):
    found.append([one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"])
    raise KeyError
kinematics.KinematicTask.prepare = looked
try:
    kinematics.calibrate_kinematics(None)
except KeyError:
    print(found[0] and set(found[0]))
"""
    plain = {"PATH": "/usr/bin:/bin", "HOME": "/tmp"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=plain, check=True
    )
    assert done.stdout.strip() == "{1}"
