"""Memory that arrays free stays with the process."""

import platform
import subprocess
import sys

import pytest

COUNT = """
import resource, sys
import numpy as np
from nico_selfmodel.freed_memory import give_back_freed_memory, keep_freed_memory
if sys.argv[1] != "given back":
    keep_freed_memory()
if sys.argv[1] == "large, let go":
    give_back_freed_memory()
faults = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_minflt
before = faults()
large = sys.argv[1].startswith("large")
for size in [3 << 20] if large else range(1 << 17, 1 << 21, 1 << 17):
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
    assert faults("large, kept") < 0.3 * faults("large, let go")
