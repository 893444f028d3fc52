"""How modules are loaded that are many: without a look for what is no longer needed."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def unsearched() -> Iterator[None]:
    """Let Python look for what refers to itself, and to which nothing else does, only afterwards.

    Modules stay, so that it finds nothing each time, which takes a twentieth of a report. All that
    there is then counts as old, and is not looked through at once; what was frozen stays frozen.
    """
    looks, frozen = gc.isenabled(), gc.get_freeze_count()
    gc.disable()
    try:
        yield
    finally:
        if not frozen:
            gc.freeze()
            gc.unfreeze()
        if looks:
            gc.enable()
