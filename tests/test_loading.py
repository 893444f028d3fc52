"""Modules are loaded without a look for what is no longer needed, which comes afterwards."""

import gc

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


def test_what_was_there_counts_as_old_and_is_still_found_when_nothing_needs_it():
    class Kept:
        gone = False

        def __del__(self):
            Kept.gone = True

    with unsearched():
        one = Kept()
        one.itself = one
    assert any(item is one for item in gc.get_objects(generation=2))
    del one
    gc.collect(1)
    assert not Kept.gone
    gc.collect()
    assert Kept.gone
