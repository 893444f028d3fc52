"""What is said where a recording contradicts what it is said to be."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA, CONTACT, PLANE, POSES
from nico_selfmodel.estimation.diagnosis.nominal_check import RobotSize, compare_sizes
from nico_selfmodel.estimation.noise.contradictions import LEAST_SHARE, WHERE_TO_LOOK
from nico_selfmodel.estimation.observations.outlier_words import (
    held_out_apart,
    more_held_out_outliers,
    name_samples,
    stuck_encoder,
)
from nico_selfmodel.estimation.results.calibration_result import CAUSE, FAILURE, LAST, Finding
from nico_selfmodel.estimation.tree.compared_errors import unexplained
from nico_selfmodel.estimation.tree.contradictions.held_scores import (
    severity_of,
    size_of,
    target_on,
)
from nico_selfmodel.estimation.tree.contradictions.sensor_noise import (
    CHECK_TOUCHES,
    unexplained_scalars,
)
from nico_selfmodel.estimation.tree.contradictions.standing_still import dead_encoders
from nico_selfmodel.estimation.tree.contradictions.views_apart import views_apart
from nico_selfmodel.estimation.tree.contradictions.wrong_readings import (
    contradicted_sensors,
    markers_elsewhere,
    poses_off,
    read_wrongly,
    seen_wrongly,
)
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.guesses.flange_guess import CHECK_FLANGE
from nico_selfmodel.estimation.tree.known.lens_parts import lens_findings
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
from nico_selfmodel.estimation.tree.tree_errors import TreeErrors
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_setup import KNOWN_PLACES
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.model.tree.body_tree import FLANGE, PRISMATIC, REVOLUTE, WORLD
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import TAGS_OF_ONE_ID, listed
from nico_selfmodel.optimization.robust_solve import OUTLIER_AT

_NOTABLE = 0.005
"""Share of a length below which it is not worth a word."""
_LARGEST_SHARE = 0.1
"""Noise that is so much of what a joint that slides moved is none."""
_EXPLAINED = 0.5
"""Part of what a body does not explain that a lens or length must, to be what is wrong."""
_VAGUE = 0.1
"""And the share to which it must be known: of poses in another frame no length fits."""
_TURNED, _SHIFTED = np.radians(10.0), 0.03
"""A joint's axis and place are off by more where a description is wrong there [rad, m]."""
_FARTHER = 5.0
"""And by so many times what joints usually are."""
_FEWEST_DESCRIBED = 4
"""Joints by which that is told."""
_LARGEST_MISS = 0.03
"""Touches that are missed by so much of the body's size tell nothing of it."""


def contradiction_findings(calibration: TreeCalibration) -> list[Finding]:
    """Return what speaks against lenses, lengths, readings and labels as they were told."""
    residuals = TreeResiduals(calibration.train.observations, calibration.parameters)
    seen, solution = residuals.observations, calibration.solution
    sliding = _sliding(calibration)
    linear = residuals.linear(calibration.values)
    found = [*sliding, *_of_sensors(calibration, lengths=not sliding)]
    found += views_apart(linear, seen, solution.outliers)
    misread = read_wrongly(linear, seen, solution)
    for joint, (wrong, of) in misread.items():
        i = calibration.data.joint_names.index(joint)
        if calibration.data.joints[i].motion == FLANGE:
            what, cause = f"poses of flange {joint!r}", CHECK_FLANGE
        else:
            what, cause = (
                f"readings of joint {joint!r}",
                (
                    dead_encoders(calibration.data, [joint])
                    or "check its unit and sign, whether another joint drives it (`follows`), and "
                    "whether it slips"
                ),
            )
        found.append(Finding(FAILURE, f"{what} would be wrong in {wrong} of {of} poses: {cause}"))
    found += _of_labels(seen, solution)
    found += _outvoted(calibration, seen)
    # A known body is held against poses as what it knows of noise and itself tells.
    poses = [] if calibration.anew else _of_poses(calibration)
    failed = [*found, *poses]
    others = [name for name in calibration.data.joint_names if name not in misread]
    return [*_stood_still(calibration, others), *failed] if failed else []


def _of_labels(seen: TreeObservations, solution: TreeSolution) -> list[Finding]:
    """Say of which links, and else of which markers, too much contradicts the rest."""
    links, found = seen_wrongly(seen, solution), list[Finding]()
    for link, (wrong, of) in links.items():
        text = (
            f"{wrong} of {of} observations of markers on {link!r} contradict the rest: check which "
            "link they are on, their labels, and the readings of the joints on the way"
        )
        found.append(Finding(FAILURE, text))
    on = {marker.name: marker.on for marker in seen.data.markers}
    for marker, (wrong, of) in markers_elsewhere(seen, solution.outliers).items():
        if on[marker] not in links:
            text = (
                f"{wrong} of {of} observations of marker {marker!r} contradict the rest, as if it "
                f"were at two places: {TAGS_OF_ONE_ID}; or check its labels, and whether it moved "
                "on its link"
            )
            found.append(Finding(FAILURE, text))
    return found


def _stood_still(calibration: TreeCalibration, others: list[str]) -> list[Finding]:
    """Say which encoder stood still, of others throughout, or in what contradicts the rest."""
    data, solution = calibration.data, calibration.solution
    if dead := dead_encoders(data, others):
        return [Finding(FAILURE, dead)]
    table, read = data.observations, [i for i, joint in enumerate(data.joints) if joint.is_read]
    told = np.flatnonzero((table.pose != ANY_POSE) & (data.seen_on != WORLD))
    pose, slipped = table.pose[told], np.append(solution.slipped.any(axis=1), False)
    off = solution.outliers[told] | slipped[np.minimum(data.visit[pose], len(slipped) - 1)]
    names = [data.joints[i].name for i in read]
    units = [data.joints[i].encoder_unit for i in read]
    readings, sample = data.readings[pose][:, read], data.sample[pose]
    stuck = stuck_encoder(names, units, readings, sample, off)
    if not stuck:
        return []
    wrong, of = np.unique(sample[off]), np.unique(sample).size
    which = f"{len(wrong)} of {of} samples ({wrong[0]} to {wrong[-1]}) contradict the rest"
    what = which if len(wrong) < of else f"no body explains any of {of} samples"
    return [Finding(FAILURE, f"{what}, {stuck}")]


def _outvoted(calibration: TreeCalibration, seen: TreeObservations) -> list[Finding]:
    """Say which sensors' observations mostly contradict the rest.

    Touches tell no body: where none explains what was seen theirs only follow.
    """
    units = "check its units, and sizes that are told (of tags, a board's squares, known distances)"
    unexplained = unexplained_scalars(calibration) > 0
    kinds = {sensor.name: sensor.kind for sensor in seen.data.sensors}
    found = []
    for name, (wrong, of) in contradicted_sensors(seen, calibration.solution.outliers).items():
        touches = kinds[name] in (CONTACT, PLANE)
        text = (
            f"{wrong} of {of} observations of sensor {name!r} contradict what the others say: "
            f"{CHECK_TOUCHES if touches else units}"
        )
        found.append(Finding(LAST if touches and unexplained else FAILURE, text))
    return found


def _of_poses(calibration: TreeCalibration) -> list[Finding]:
    """Say in which poses most of what was seen is off, of those learned from and held out."""
    asked = poses_off(calibration.data, calibration.solution.outliers)
    both = [("", asked)]
    if calibration.test is not None and calibration.usual_test is not None:
        data, far = calibration.test.observations.data, calibration.test.by_row()
        share = max(LEAST_SHARE, asked.count / max(len(asked.found), 1))
        off = far > OUTLIER_AT * calibration.usual_test
        both.append(("held-out ", poses_off(data, off, share)))
    return [
        Finding(
            FAILURE,
            f"in {one.count} of {len(one.found)} {which}poses "
            f"({name_samples(one.sample[one.found])}) most of what was seen contradicts the rest: "
            f"{WHERE_TO_LOOK}, or in other units",
        )
        for which, one in both
        if one.too_many and one.count < len(one.found)
    ]


def misdescribed_words(calibration: TreeCalibration) -> list[str]:
    """Name joints whose axis or place is much farther from the description than others'."""
    joints, index = calibration.tree.joints, calibration.parameters.index
    if calibration.description is None or len(joints) < _FEWEST_DESCRIBED:
        return []
    off: dict[str, list[str]] = {}
    for parts, least, scale, unit in (
        (("rx", "ry"), _TURNED, np.degrees(1.0), "deg"),
        (("x", "y", "z"), _SHIFTED, 1e3, "mm"),
    ):
        at = np.array([[index[f"{joint}.{part}"] for part in parts] for joint in joints])
        far = np.linalg.norm(calibration.values[at], axis=1)
        limit = max(least, _FARTHER * float(np.median(far)))
        for joint, one in zip(joints, far.tolist(), strict=True):
            if one > limit:
                off.setdefault(joint, []).append(f"{scale * one:.3g} {unit}")
    if not off:
        return []
    said = [f"{joint!r} by {' and '.join(words)}" for joint, words in off.items()]
    return [
        f"the robot's description is much farther off at some joints than at others: {listed(said)}"
        "; check their axes and origins there (the joint behind a wrong one follows it)"
    ]


def described_size(calibration: TreeCalibration) -> RobotSize | None:
    """Compare a body with its description by the joints that moved what was seen, or what saw.

    Returns:
        None where there is no description, or nothing tells.
    """
    tree, data = calibration.tree, calibration.data
    if calibration.description is None:
        return None
    links = [tree.markers[m].on for m in np.unique(data.observations.marker).tolist()]
    links += [sensor.on for sensor in tree.sensors]
    turning = np.array([motion == REVOLUTE for motion in tree.motions])
    moved = np.flatnonzero(tree.beyond[links].any(axis=0) & turning)
    lines = []
    for one in (calibration.description.tree, tree):
        still = TreeMotion.at(one, np.zeros((1, len(tree.joints))))
        lines.append((still.R_WJ[moved, :, 2, 0], still.p_WJ[moved, :, 0]))
    return compare_sizes(*lines)


def missed_touches(calibration: TreeCalibration) -> list[str]:
    """Say which touches and distances are missed by what is no noise."""
    left = calibration.train.of_touches(~calibration.solution.outliers)
    missed = {name: float(np.sqrt(np.mean(far**2))) for name, far in left.items()}
    return [
        f"what {name!r} tells is missed by {1e3 * rms:.3g} mm (rms), on a body of "
        f"{1e3 * calibration.size:.0f} mm: {CHECK_TOUCHES}"
        for name, rms in missed.items()
        if rms > _LARGEST_MISS * calibration.size
    ]


def _sliding(calibration: TreeCalibration) -> list[Finding]:
    """Say which joints that slide moved by something else than they were read to."""
    data, found = calibration.data, []
    noisy = calibration.train.observations.noisy_joints
    for (i, _), sigma in zip(noisy, calibration.solution.noise.joint.tolist(), strict=True):
        travel = float(np.ptp(data.si_readings[:, i]))
        if data.joints[i].motion == PRISMATIC and sigma > _LARGEST_SHARE * max(travel, 1e-9):
            name = data.joints[i].name
            cause = dead_encoders(data, [name]) or "check its unit"
            text = (
                f"noise of joint {name!r} would have to be {1e3 * sigma:.3g} mm, of "
                f"{1e3 * travel:.3g} mm that it moved: {cause}"
            )
            found.append(Finding(CAUSE, text))
    return found


def _of_sensors(calibration: TreeCalibration, *, lengths: bool) -> list[Finding]:
    """Say which lenses and lengths the recording contradicts; all lenses in one sentence."""
    least = _EXPLAINED * unexplained_scalars(calibration)
    found = lens_findings(calibration.lens_parts, calibration.tree.lenses, least)
    for name, score in calibration.held.items() if lengths else ():
        severity, (value,), (sigma,) = severity_of(score), score.values, score.sigma
        notable = abs(value) > _NOTABLE and sigma < _VAGUE
        if not severity or not notable or score.gain < least:
            continue
        factor = float(np.exp(value))
        measured = name in {rows.name for rows in calibration.train.observations.sensors}
        what = f"what sensor {name!r} measured is" if measured else f"{name} is told"
        text = (
            f"{what} {factor:.4g} +- {factor * sigma:.2g} times as long as all else "
            f"says{as_printed(calibration.data, name, factor)}: check the size of the target (a "
            "tag, a board's squares, `xyz` of markers), distances, and units"
        )
        found.append(Finding(severity, text))
    return sorted(found, key=lambda one: one.severity != CAUSE)


def as_printed(data: BodyDataset, name: str, factor: float) -> str:
    """Say how large a target is printed that is told so many times too large, if it is one.

    Several markers of a sensor of poses are tags; one may be a board.
    """
    places = [m.xyz for m in data.markers if m.xyz and name in (size_of(m.on), target_on(m.on))]
    larger = 100.0 * (1.0 / factor - 1.0)
    off = f"{abs(larger):.1f} % {'larger' if larger > 0.0 else 'smaller'}"
    poses = {s: sensor.name for s, sensor in enumerate(data.sensors) if sensor.kind == POSES}
    if name in poses.values():
        table = data.observations
        seen = np.unique(table.marker[[poses.get(s) == name for s in table.sensor.tolist()]])
        what = "tags are" if len(seen) > 1 else "the tag is, or the board's squares are"
        return f" ({what} {off} than was told: {25.0 / factor:.1f} mm if that was 25)"
    if len(places) < 2:
        return ""
    apart = np.linalg.norm(np.array(places)[:, None] - np.array(places), axis=2)
    told = 1e3 * float(apart[apart > 0.0].min(initial=apart.max()))
    return f" (it is {off}: its nearest markers are {told / factor:.1f} mm apart, not {told:.1f})"


def size_words(calibration: TreeCalibration) -> list[str]:
    """Say where lengths rest on a target's stated size, and how well all else tells that."""
    poses = {s.name for s in calibration.data.sensors if s.kind == POSES}
    rests = {name: f"of what sensor {name!r} takes the poses of" for name in poses}
    boards = [size_of(calibration.data.joints[i].name) for i in calibration.data.free_joints]
    if calibration.setup.scale_from == KNOWN_PLACES:
        boards += [target_on(link) for link in {marker.on for marker in calibration.data.markers}]
    rests |= {board: f"of {board}" for board in boards}
    return [
        f"lengths rest on the size that is stated {rests[name]}: "
        + (
            "nothing else tells them, one that is 1 % too large makes all of them so"
            if score.sigma[0] > _VAGUE
            else f"all else tells them to {100.0 * score.sigma[0]:.1f} %, and would have them "
            f"{100.0 * np.expm1(-score.values[0]):+.1f} %"
        )
        for name, score in calibration.held.items()
        if name in rests and score.sigma[0] > _NOTABLE
    ]


def held_out_words(calibration: TreeCalibration, test: TreeErrors) -> str:
    """State the held-out errors; where no noise explains some of them, without these and with."""
    where = f"{len(np.unique(test.observations.pose))} poses that were held out"
    with_all, off = _sizes(test), _unexplained(test, calibration.usual_test)
    if not off.any():
        return f"{with_all} mean error on {where}"
    return held_out_apart(
        _sizes(test, ~off),
        where,
        _samples_of(test, off),
        off[np.isfinite(test.by_row())],
        "observations",
        _sizes(test, off, np.max),
        with_all,
    )


def held_out_reason(calibration: TreeCalibration) -> str | None:
    """Say when held-out poses contradict the body far more often than training poses do."""
    test, train = calibration.test, calibration.train
    if test is None:
        return None
    off = _unexplained(test, calibration.usual_test)
    before = calibration.solution.outliers | _unexplained(train, calibration.usual)
    return more_held_out_outliers(
        off[np.isfinite(test.by_row())],
        "observations",
        _samples_of(test, off) if off.any() else "",
        _count_poses(test, off),
        _count_poses(train, before),
        "something changed between the recordings, or was detected or read wrongly more often",
    )


def _unexplained(errors: TreeErrors, usual: NDArray | None) -> NDArray:
    """Return which of the errors that are stated no noise explains. Boolean, shape (N,)."""
    data = errors.observations.data
    kind = np.array([sensor.kind for sensor in data.sensors])[data.observations.sensor]
    return unexplained(errors, usual) & np.isin(kind, (CAMERA, *errors.in_space))


def _samples_of(errors: TreeErrors, rows: NDArray) -> str:
    """Name the samples of some rows of the table. Boolean, shape (N,)."""
    data = errors.observations.data
    pose = data.observations.pose[rows]
    return name_samples(np.unique(data.sample[pose[pose != ANY_POSE]]))


def _count_poses(errors: TreeErrors, rows: NDArray) -> tuple[int, int]:
    """Return how many poses some rows of the table are of, and how many there are."""
    own, every = errors.observations.data.observations.pose[rows], errors.observations.pose
    found, there = (np.unique(pose[pose != ANY_POSE]) for pose in (own, every))
    return len(found), len(there)


def _sizes(
    test: TreeErrors, keep: NDArray | None = None, of: Callable[[NDArray], float] = np.mean
) -> str:
    """Return the mean of the errors, or another number of them, in space and in the images."""
    pixels, points = (test.of_kind(*k, keep=keep) for k in ((CAMERA,), test.in_space))
    parts = [f"{1e3 * of(points):.3g} mm"] if len(points) else []
    parts += [f"{of(pixels):.3g} px"] if len(pixels) else []
    return " and ".join(parts)
