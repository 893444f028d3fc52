"""Modules are loaded without a look for what is no longer needed, which comes afterwards."""

import gc
import subprocess
import sys

import pytest

from nico_selfmodel.loading import unsearched


@pytest.mark.parametrize("looks", [True, False])
def test_nothing_is_looked_for_meanwhile_and_as_before_afterwards(looks):
    before = gc.isenabled()
    (gc.enable if looks else gc.disable)()
    try:
        with unsearched():
            assert not gc.isenabled()
        assert gc.isenabled() == looks
    finally:
        (gc.enable if before else gc.disable)()


COUNTED = """
import gc, sys
from nico_selfmodel.loading import unsearched
class Kept:
    gone = False
    def __del__(self):
        Kept.gone = True
if sys.argv[1] == "frozen":
    gc.freeze()
with unsearched():
    one = Kept()
    one.itself = one
print("frozen" if gc.get_freeze_count() else "loose")
print("old" if any(item is one for item in gc.get_objects(generation=2)) else "young")
del one
gc.collect(1)
print("gone" if Kept.gone else "there")
gc.collect()
print("gone" if Kept.gone else "there")
"""


@pytest.mark.parametrize(
    ("before", "found"),
    [("loose", "loose old there gone"), ("frozen", "frozen young gone gone")],
)
def test_all_there_is_counts_as_old_unless_somebody_froze_what_there_was(before, found):
    words = [sys.executable, "-c", COUNTED, before]
    ran = subprocess.run(words, capture_output=True, text=True, check=True, timeout=60)
    assert ran.stdout.split() == found.split()
