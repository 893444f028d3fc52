"""Memory that arrays free stays with the process."""

import platform
import subprocess
import sys

import pytest

COUNT = """
import resource, sys
import numpy as np
from nico_selfmodel.freed_memory import keep_freed_memory
if sys.argv[1] == "kept":
    keep_freed_memory()
faults = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_minflt
before = faults()
for size in range(1 << 17, 1 << 21, 1 << 17):
    for _ in range(20):
        np.ones(size // 8), np.ones(size // 16)
print(faults() - before)
"""


def faults(kept):
    done = subprocess.run(
        [sys.executable, "-c", COUNT, kept], capture_output=True, text=True, check=True, timeout=60
    )
    return int(done.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another library keeps what is freed")
def test_arrays_that_come_and_go_are_cleared_by_the_system_once():
    assert faults("kept") < 0.3 * faults("given back")
