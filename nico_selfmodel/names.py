"""Names that people give and messages list: which are valid, how many are shown, what was meant."""

import difflib
import reprlib
from collections.abc import Collection, Iterable

LONGEST_NAME = 200
"""Characters that a name may have."""
_MOST_LISTED = 8
TAGS_OF_ONE_ID = "tags of one id cannot be told apart, give each its own"
"""What is said where one marker is at two places at once."""


def check_name(text: object, what: str, *, in_table: bool = True) -> None:
    """Check a name: printable text of at most 200 characters, not empty.

    What is not printable (escapes, controls, marks that turn the direction of writing) would
    act on the terminals that show it.

    Args:
        what: What it names, for the message.
        in_table: Whether it goes into a table, which strips the spaces at its ends.

    Raises:
        ValueError: If it is not such a name.
    """
    if not isinstance(text, str) or not text.strip() or not text.isprintable():
        raise ValueError(f"{what} must be printable text, got {shown(text)}")
    if in_table and text != text.strip():
        raise ValueError(
            f"{what} must be printable text without spaces at its ends, got {shown(text)}"
        )
    if len(text) > LONGEST_NAME:
        raise ValueError(
            f"{what} must have at most {LONGEST_NAME} characters, got {len(text)}: {shown(text)}"
        )


def shown(value: object) -> str:
    """Return a value as a message shows it: its `repr`, shortened where it is long."""
    return _SHORT.repr(value)


def listed(names: Iterable[object], close_to: str | None = None, most: int = _MOST_LISTED) -> str:
    """Return names as a message lists them, the first few and how many more there are.

    Args:
        close_to: What was written instead; the names that are most like it come first.
        most: How many are shown at most.

    Returns:
        `a, b, c`, or `a, b, ... and 5 more`.
    """
    texts = [str(name) for name in names]
    if len(texts) <= most:
        return ", ".join(texts)
    if close_to is not None:
        close = difflib.get_close_matches(close_to, texts, most, 0.4)
        texts = list(dict.fromkeys([*close, *texts]))
    return f"{', '.join(texts[:most])}, ... and {len(texts) - most} more"


def called(kind: str, name: str) -> str:
    """Return a name with what it is the name of, said once: `joint elbow`, `joint_1`."""
    return name if name.startswith(kind) else f"{kind} {name}"


def refuse_unknown(what: str, name: str, known: Collection[str]) -> None:
    """Refuse a name that does not exist, with those that do.

    Args:
        what: What it is the name of, such as `joint`.
        name: What was written.
        known: All that exist.

    Raises:
        ValueError: If it is not among them: `no joint 'elbw', did you mean 'elbow'? There are ...`.
    """
    if name not in known:
        hint = did_you_mean(name, known)
        there = "? There" if hint else "; there"
        raise ValueError(
            f"no {what} {name!r}{hint.rstrip('?')}{there} are {listed(known, name) or 'none'}"
        )


def did_you_mean(name: str, known: Iterable[str], likeness: float = 0.6) -> str:
    """Return `, did you mean 'x'?` for the closest known name, or an empty text.

    Args:
        name: What was written.
        known: What could have been meant.
        likeness: How alike the two must be, 0 to 1.

    Returns:
        The hint, beginning with a comma.
    """
    close = _closest(name, known, likeness)
    return f", did you mean {close!r}?" if close else ""


def found_instead(name: str, found: Iterable[str]) -> str:
    """Return `, but 'x' looks like it: rename it` for a missing name, or an empty text.

    Args:
        name: What is missing.

    Returns:
        The hint, beginning with a comma.
    """
    close = _closest(name, found, 0.6)
    return f", but {close!r} looks like it: rename it" if close else ""


def _closest(name: str, others: Iterable[str], likeness: float) -> str | None:
    # Long words take difflib seconds, and are no misspelt names.
    by_lower_case = {other.lower(): other for other in others if len(other) <= LONGEST_NAME}
    close = difflib.get_close_matches(name[:LONGEST_NAME].lower(), by_lower_case, 1, likeness)
    return by_lower_case[close[0]] if close else None


_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3
_SHORT.maxstring = _SHORT.maxother = 80
_SHORT.maxlong = 40
