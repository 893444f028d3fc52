"""Importing the package costs little, says nothing and reaches for nothing."""

import pkgutil
import subprocess
import sys

import pytest

import nico_selfmodel

LIGHT = """
import sys
import nico_selfmodel
heavy = {"cv2", "matplotlib", "meshcat", "numpy", "pydrake", "scipy", "typer"}
assert not heavy & set(sys.modules), sorted(heavy & set(sys.modules))
"""

# Python's own sockets show in the audit events, those of C++ (Drake, zmq) among the open files.
QUIET = """
import importlib, os, sys, threading

def open_sockets():
    links = []
    for number in os.listdir("/proc/self/fd"):
        try:
            links.append(os.readlink(f"/proc/self/fd/{number}"))
        except FileNotFoundError:  # the listing's own
            pass
    return {link for link in links if link.startswith("socket:")}

def watch(event, arguments):
    if event in {"socket.bind", "socket.connect", "socket.getaddrinfo"}:
        raise AssertionError(f"import reaches for the network: {event} {arguments}")

before = open_sockets()
sys.addaudithook(watch)
for name in sys.argv[1:]:
    importlib.import_module(name)
assert open_sockets() <= before, "import left a socket open"
assert threading.active_count() == 1, threading.enumerate()
"""


def run(script, *arguments):
    return subprocess.run(
        [sys.executable, "-c", script, *arguments], capture_output=True, text=True, timeout=120
    )


@pytest.fixture(scope="module")
def module_names():
    found = pkgutil.walk_packages(nico_selfmodel.__path__, "nico_selfmodel.")
    names = [module.name for module in found]
    assert len(names) > 10
    return names


def test_the_package_alone_imports_nothing_heavy():
    result = run(LIGHT)
    assert result.returncode == 0, result.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="reads the open files from /proc")
def test_no_module_opens_a_socket_starts_a_thread_or_prints(module_names):
    result = run(QUIET, *module_names)
    assert result.returncode == 0, result.stderr
    assert result.stdout == ""
    assert result.stderr == ""
