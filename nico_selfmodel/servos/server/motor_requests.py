"""What a client may ask of the motor server: lines of JSON, read with suspicion."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from nico_selfmodel.errors import SelfModelError

KEYS: Mapping[str, tuple[str, ...]] = {
    "describe": (),
    "enable": ("joints",),
    "lease": ("seconds",),
    "move": ("targets", "speed_rad_s"),
    "release": (),
    "renew": (),
    "state": (),
    "stop": (),
}
"""What each request may carry besides its "op" and a lease."""
_LONGEST_WORDS = 60
_HTTP = re.compile(rb"[A-Za-z]+ +\S+ +HTTP/")


class RefusedError(SelfModelError):
    """A request that cannot be granted; its message is the answer."""


class NotARequestError(RefusedError):
    """A line that is no request at all: who sends it speaks something else."""


def read_request(line: bytes) -> Mapping[str, Any]:
    """Read a line.

    Args:
        line: One JSON object with an "op", in UTF-8.

    Returns:
        The request; its "op" is one of `KEYS`, and it carries nothing else than that may.

    Raises:
        NotARequestError: If it is something else: HTTP, other JSON, a key that stands twice.
        RefusedError: If there is no such op, or no such key in it.
    """
    request = _read_object(line)
    op = request["op"]
    if op not in KEYS:
        raise RefusedError(f"no op {brief(op)}; there are {', '.join(KEYS)}")
    known = ("op", "lease", *KEYS[op])
    # Whatever else it says: who wants the arm to stop is heard.
    strange = [key for key in request if key not in known and op != "stop"]
    if strange:
        raise RefusedError(f"no key {brief(strange[0])} in {op!r}; there are {', '.join(known)}")
    return request


def _read_object(line: bytes) -> Mapping[str, Any]:
    if _HTTP.match(line):
        # A web page can have a browser send any body, but not choose the first line.
        raise NotARequestError('this is no web server: a request is an object with an "op"')
    try:
        request = json.loads(line.decode("utf-8"), object_pairs_hook=_each_key_once)
    except RecursionError:
        deep = 'a request is an object with an "op", not so many in each other'
        raise NotARequestError(deep) from None
    except ValueError as error:
        raise NotARequestError(f'a request is an object with an "op": {error}') from None
    if not isinstance(request, Mapping) or not isinstance(request.get("op"), str):
        raise NotARequestError(f'a request is an object with an "op", got {brief(request)}')
    return request


def _each_key_once(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key stands twice")
    return found


def number(value: object, what: str) -> float:
    """Return a number that a request holds.

    Args:
        what: What that is, for the message.

    Raises:
        RefusedError: If it is none, or none that is finite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RefusedError(f"{what} must be a number, got {brief(value)}")
    try:
        found = float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise RefusedError(f"{what} must be a finite number, got {brief(value)}")
    return found


def brief(value: object) -> str:
    """Return what somebody sent, in few words."""
    if isinstance(value, int) and not -1e18 < value < 1e18:
        return "a whole number of more than 18 digits"
    if isinstance(value, Mapping | list):
        return f"{'an object' if isinstance(value, Mapping) else 'a list'} of {len(value)}"
    words = repr(value)
    return words if len(words) <= _LONGEST_WORDS else f"{words[:_LONGEST_WORDS]}..."
