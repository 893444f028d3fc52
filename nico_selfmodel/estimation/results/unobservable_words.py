"""Unobservable directions in words, with what would cure them."""

from collections.abc import Collection, Sequence

from nico_selfmodel.names import listed
from nico_selfmodel.optimization.uncertainty import UnobservableDirection

_MEANING = {
    "D": "offset along its axis",
    "theta_offset": "encoder zero",
    "r": "link length",
    "alpha": "twist to the next axis",
    "beta": "second twist to the next axis",
    "gear": "gear",
}

_CURE = {
    "gear": "move {joint} through a wider range, with the tracked point off its axis",
    "theta_offset": "track a point further from the axis of {joint}, and fix `{name}` if it was "
    "freed by hand",
    "alpha": "track a second point, or fix `{name}`",
    "beta": "fix `{name}`, unless the axes at {joint} are nearly parallel",
    "D": "move the joints next to {joint} further, or fix `{name}`",
    "r": "move the joints next to {joint} further, or fix `{name}`",
}


def describe_unobservable(direction: UnobservableDirection) -> str:
    """Say in a sentence which parameters a direction joins and what would cure it.

    Args:
        direction: A direction that the data do not determine.

    Returns:
        For example "right_elbow.gear (gear) cannot be told from ...: move right_elbow ...".
    """
    return f"{name_unobservable(direction)}: {_cure(direction.names[0])}"


def name_unobservable(direction: UnobservableDirection) -> str:
    """Say which parameters a direction joins, without what would cure it."""
    first, *others = direction.names
    words = f"`{first}` ({_meaning(first)})"
    if others:
        words += " cannot be told from " + ", ".join(f"`{name}`" for name in others)
    else:
        words += " has no effect on what was measured"
    return words


def why_so_few_are_refused(
    found: str, directions: Sequence[UnobservableDirection], zeros: Collection[str]
) -> str:
    """Say in a line what few poses leave open of what is learned anew, and what would tell it.

    A joint beyond all that was seen moves nothing of it, however many poses there are.

    Args:
        found: What there is, with its verb: "5 poses are".
        directions: What it does not tell, at least one.
        zeros: Parameters that are zeros of joints.
    """
    still = [one for one in directions if len(one.names) == 1 and one.names[0] in zeros]
    joined = [one for one in directions if one not in still]
    words = []
    if joined:
        named = "; ".join(name_unobservable(one) for one in joined)
        words = [
            f"{found} too few or too alike: {named}: record more poses, spread over the workspace"
        ]
    if still:
        named = listed([f"`{one.names[0]}`" for one in still])
        words.append(
            f"no number of poses tells {named}, for these joints move nothing that was seen: "
            "record a marker beyond them and off their axes, or name the joints whose zeros are "
            "lost by --joint"
        )
    return "; ".join(words)


def _meaning(name: str) -> str:
    joint, _, part = name.rpartition(".")
    if name.startswith("M0."):
        return "base of the chain"
    return _MEANING[part] if part in _MEANING else f"{joint.replace('hand.', 'point ')}"


def _cure(name: str) -> str:
    joint, _, part = name.rpartition(".")
    if part in _CURE and joint != "M0":
        return _CURE[part].format(joint=joint, name=name)
    return f"record poses that spread further over the workspace, or fix `{name}`"
