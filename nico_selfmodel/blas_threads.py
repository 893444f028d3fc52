"""One BLAS thread while we estimate: two make small factorisations up to 25 times slower."""

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

from nico_selfmodel.freed_memory import keep_freed_memory

_Given = ParamSpec("_Given")
_Found = TypeVar("_Found")


def on_one_blas_thread(function: Callable[_Given, _Found]) -> Callable[_Given, _Found]:
    """Let a function run on one BLAS thread; what the process had before comes back after it.

    The number is one for the whole process. Of calls that overlap in several threads the first one
    sets it and gives it back.
    """

    @functools.wraps(function)
    def alone(*args: _Given.args, **kwargs: _Given.kwargs) -> _Found:
        with _libraries().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return alone


@functools.cache
def _libraries() -> ThreadpoolController:
    """Return the BLAS libraries of this process; to find them takes some milliseconds."""
    import numpy.linalg  # noqa: F401  whose BLAS must be there

    keep_freed_memory()
    return ThreadpoolController()
