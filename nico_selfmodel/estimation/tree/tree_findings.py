"""What speaks for and against a body learned from any sensors."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.dataset.body.sensors import DISTANCE, FIRST_SIGMA, SIGHTS
from nico_selfmodel.estimation.bending.what_bends import (
    bending_faults,
    bending_warnings,
    kept_words,
)
from nico_selfmodel.estimation.diagnosis.changes_in_time import Change
from nico_selfmodel.estimation.diagnosis.flatness import bent_reasons
from nico_selfmodel.estimation.diagnosis.gear_check import DoubtfulGear, gear_words
from nico_selfmodel.estimation.observations.outlier_words import equal_readings
from nico_selfmodel.estimation.results.calibration_result import (
    CAUSE,
    FAILURE,
    LAST,
    MISFIT,
    NOTE,
    WARNING,
    Finding,
    findings,
)
from nico_selfmodel.estimation.tree.contradictions.contradiction_words import (
    contradiction_findings,
    described_size,
    held_out_reason,
    held_out_words,
    misdescribed_words,
    missed_touches,
    size_words,
)
from nico_selfmodel.estimation.tree.contradictions.exchanged_markers import exchanged_markers
from nico_selfmodel.estimation.tree.contradictions.flange_words import both_inverted, flange_misfits
from nico_selfmodel.estimation.tree.contradictions.heavy_tails import slipping_joints
from nico_selfmodel.estimation.tree.contradictions.ran_away import (
    CHECK_READINGS,
    noise_words,
    noisy_joints,
)
from nico_selfmodel.estimation.tree.contradictions.sensor_noise import (
    loose_sigmas,
    sensor_misfits,
    unexplained_sensors,
)
from nico_selfmodel.estimation.tree.contradictions.standing_still import (
    dead_encoders,
    frozen_reading,
)
from nico_selfmodel.estimation.tree.contradictions.wrong_readings import noisy_gears
from nico_selfmodel.estimation.tree.known.described_scale import contradicted_description
from nico_selfmodel.estimation.tree.noise.finer_noise import TURN_NOISE
from nico_selfmodel.estimation.tree.timing.moved_meanwhile import moved_meanwhile
from nico_selfmodel.estimation.tree.timing.off_at_once import sensors_off_at_once
from nico_selfmodel.estimation.tree.timing.patterned_errors import patterned_findings
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
from nico_selfmodel.estimation.tree.tree_observations import ENOUGH_TOUCHES
from nico_selfmodel.estimation.tree.tree_setup import DESCRIBED
from nico_selfmodel.model.tree.body_tree import REVOLUTE
from nico_selfmodel.names import listed

_LOUD = 2.0
"""Times the noise of others from which on that of a joint is named."""
_WHOLE_SIGHT = 4
"""Outliers of one sight, and nothing else of it, from which on it is named and not its markers."""
_OUTLIERS_NAMED = 2
"""Outliers of one marker from which on it is named."""
SCALE = (
    "scale: nothing in the data tells lengths, a body twice as large at twice the distance looks "
    "the same; record a known distance (`distance_m`), a tracker, or fix one length, as that of "
    "calibrated cameras from each other (`--cameras`)"
)
"""What is said where everything could be larger."""


def tree_findings(calibration: TreeCalibration) -> tuple[Finding, ...]:
    """Return what speaks for and against a body beyond what every calibration is asked."""
    test, ladder = calibration.test, calibration.ladder
    size = described_size(calibration)
    unexplained = [*unexplained_sensors(calibration), *flange_misfits(calibration)]
    bend, asked = ladder.solution, not (calibration.anew or unexplained)
    change = moved_meanwhile(bend.problem, bend.solution) if asked else calibration.meanwhile
    gears = _doubtful_gears(calibration)
    rigid = ladder.kept and not ladder.adopted  # is told what it would gain
    asked = asked and not (gears or rigid or (change is not None and change.explains))
    patterned = patterned_findings(bend.problem, bend.solution) if asked else []
    said = [] if test is None else [held_out_words(calibration, test)]
    said += size_words(calibration)
    if calibration.setup.scale_from == DESCRIBED and calibration.by_description is None:
        said.append("scale: the robot's description alone tells it, one 1 % too large makes all so")
    said += kept_words(ladder, calibration.tree.bending, calibration.at)
    doubts = [f"too few poses to test whether mirror {name!r} is flat: record ten"
              for name, test in calibration.flatness.items() if test is None]  # fmt: skip
    data = calibration.data
    seen = np.isin(np.arange(len(data.sample)), data.observations.pose)
    doubts += [
        *equal_readings(int(seen.sum()), len(np.unique(data.pose[seen]))),
        *(misdescribed_words(calibration) if size is None or not size.reason else []),
        *([size.warning] if size is not None and size.warning else []),
        *_told_by_no_pose(calibration),
        *_seldom_words(calibration),
        *([calibration.by_description.warning] if calibration.by_description else []),
        *_alike_words(calibration),
        *both_inverted(calibration),
        *_slip_words(calibration),
        *loose_sigmas(calibration),
        *_assumed_sigmas(calibration),
        *_loud_words(calibration, gears),
        *exchanged_markers(calibration),
        *sensors_off_at_once(calibration),
        *_outlier_words(calibration),
        *distance_words(calibration),
        *([change.warning] if change is not None and change.warning else []),
    ]
    changed = [change.reason] if change is not None and change.reason else []
    cause = change is not None and change.explains
    return (
        *_late_findings(calibration.late),
        *findings(CAUSE, changed if cause else []),
        *findings(CAUSE, [frozen_reading(data, _set_aside(calibration))]),
        *patterned,
        *contradiction_findings(calibration),
        *findings(
            MISFIT, [*_noise_reasons(calibration), *sensor_misfits(calibration), *unexplained]
        ),
        *findings(FAILURE, [] if cause else changed),
        *findings(FAILURE, [size and size.reason, *_contradicted_description(calibration)]),
        *findings(FAILURE, bent_reasons(calibration.flatness)),
        *findings(FAILURE, [*bending_faults(ladder), *gear_words(gears)]),
        *findings(LAST, [*missed_touches(calibration), held_out_reason(calibration)]),
        *findings(WARNING, [*bending_warnings(ladder, calibration.at), *doubts]),
        *findings(NOTE, said),
    )


def _late_findings(late: Change | None) -> list[Finding]:
    """Say what is of another moment: before joints and gears are blamed for it."""
    if late is None:
        return []
    kind = CAUSE if late.explains else FAILURE if late.notable else WARNING
    return [Finding(kind, late.what if late.notable else str(late.warning))]


def _told_by_no_pose(calibration: TreeCalibration) -> list[str]:
    """Name what is open whatever is recorded, and what that means."""
    both = zip(calibration.uncertainty.unobservable, calibration.told_by_no_pose, strict=True)
    said = []
    for names in (way.names for way, by_none in both if by_none):
        some = len(names) > 1
        said.append(
            f"{listed([f'`{name}`' for name in names])} {'go together' if some else 'is open'}: in "
            "no pose between its joints' limits can what sensors see of this body tell "
            f"{'them apart' if some else 'it'}, and nothing that they see depends on it; "
            f"{'they have' if some else 'it has'} no sigma of {'their' if some else 'its'} own"
        )
    return said


def _seldom_words(calibration: TreeCalibration) -> list[str]:
    """Name markers that were seen too seldom: nothing else hangs on where they are."""
    sights = calibration.unplaced
    if not sights:
        return []
    told = [f"`{name}` ({count} times)" for name, count in sorted(sights.items())]
    many = len(told) > 1
    return [
        f"{listed(told)} {'were' if many else 'was'} seen too seldom to tell where "
        f"{'they are' if many else 'it is'}, the rest is learned without: record poses that show "
        f"{'them' if many else 'it'} from other places, or leave {'their' if many else 'its'} rows "
        "out of observations.csv"
    ]


def _contradicted_description(calibration: TreeCalibration) -> list[str]:
    """Say that a description which alone tells lengths is farther off than it is stated to be."""
    description, names = calibration.description, calibration.parameters.of_joint_frames
    if description is None or description.learned or calibration.setup.scale_from != DESCRIBED:
        return []
    priors = calibration.ladder.solution.problem.priors
    priors = {name: prior for name, prior in priors.items() if name in names}
    values = dict(zip(calibration.parameters.names, calibration.values.tolist(), strict=True))
    said = contradicted_description(priors, values, calibration.uncertainty)
    return [said] if said else []


def _assumed_sigmas(calibration: TreeCalibration) -> list[str]:
    """Say which distances and touches are too few to tell their noise, which nobody stated."""
    seen, data = calibration.train.observations, calibration.data
    held = [
        f"{rows.name!r} to {1e3 * FIRST_SIGMA[rows.kind]:.3g} mm"
        for rows in seen.sensors
        if seen.sigma_held[seen.noise_group[rows.first]] and data.sensors[rows.sensor].sigma is None
    ]
    if not held:
        return []
    return [
        f"nothing tells how sure distances or touches are, those of {listed(held)} is assumed: "
        "error bars of lengths rest on it; state `sigma_m` of the sensor, or record "
        f"{ENOUGH_TOUCHES} poses with them"
    ]


def _noise_reasons(calibration: TreeCalibration) -> list[str]:
    data, seen = calibration.data, calibration.train.observations
    turning = noisy_joints(seen, calibration.solution)
    if not turning:
        return []
    cause = CHECK_READINGS
    if any(marker.xyz and f"{marker.name}.x" in calibration.setup.told for marker in data.markers):
        cause += "; 'xyz' of markers on a link are in its joint's frame, z the joint's axis"
    cause = dead_encoders(data, turning) or cause
    return [noise_words(turning, cause)]


def _slip_words(calibration: TreeCalibration) -> list[str]:
    """Name joints that were read wrongly in more poses than by chance, and than others."""
    slipped, noisy = calibration.solution.slipped, calibration.train.observations.noisy_joints
    named = slipping_joints(calibration.ladder.solution.problem, calibration.solution)
    return [
        f"the encoder of {calibration.data.joints[noisy[k][0]].name!r} was off in "
        f"{slipped[:, k].sum()} of {len(slipped)} poses by more than joint noise: look for play, "
        "a loose coupling or missed counts there"
        for k in np.flatnonzero(named).tolist()
    ]


def _doubtful_gears(calibration: TreeCalibration) -> list[DoubtfulGear]:
    """Return gears that contradict their units, by the ladder or in what is taken for noise."""
    found = [*calibration.ladder.doubtful_gears]
    if found or unexplained_sensors(calibration):
        return found
    bend = calibration.ladder.solution
    return noisy_gears(bend.problem, bend.solution)


def _loud_words(calibration: TreeCalibration, doubtful: list[DoubtfulGear]) -> list[str]:
    """Name joints that are read less surely than those they were taken for alike."""
    noise, noisy = calibration.solution.noise, calibration.train.observations.noisy_joints
    contradicted = {gear.name.removesuffix(".gear") for gear in doubtful}
    out = []
    for k in sorted(noise.loud):
        joint = calibration.data.joints[noisy[k][0]]
        alike = [
            sigma
            for n, ((i, _), sigma) in enumerate(zip(noisy, noise.joint.tolist(), strict=True))
            if n not in noise.loud and calibration.data.joints[i].motion == joint.motion
        ]
        usual, own = float(np.median(alike or [np.inf])), float(noise.joint[k])
        if joint.name in contradicted or own < _LOUD * usual:
            continue
        turns = joint.motion == REVOLUTE
        unit, scale = ("deg", np.degrees(1.0)) if turns else ("mm", 1e3)
        out.append(
            f"joint {joint.name!r} is read {own / usual:.2g} times as badly as others "
            f"({scale * own:.2g} {unit}, {scale * usual:.2g} {unit}), which is counted: look for "
            "play, a worn gear or a loose coupling there"
        )
    return out


def alike_errors(calibration: TreeCalibration) -> dict[str, dict[str, float]]:
    """Return what errors of flanges and sensors are shared by poses that are alike, and are not.

    Returns:
        Standard deviations [rad and m] by name; nothing where each pose's error is its own.
    """
    seen = calibration.train.observations
    out: dict[str, dict[str, float]] = {}
    for alike in calibration.solution.noise.alike:
        for k in np.flatnonzero(alike.sigma > 0.0).tolist():
            if alike.turns is None:
                i, part = seen.noisy_joints[k]
                name = calibration.data.joints[i].name
            else:
                name, part = seen.noise_groups[alike.turns].removesuffix(f" {TURN_NOISE}"), k
            kind = "turn" if part < 3 else "place"
            both = {f"shared_{kind}": float(alike.sigma[k]), f"own_{kind}": float(alike.alone[k])}
            out.setdefault(name, {}).update(both)
    return out


def _alike_words(calibration: TreeCalibration) -> list[str]:
    out = []
    for name, one in alike_errors(calibration).items():
        shared, own = (f"{np.degrees(one[f'{of}_turn']):.2f} deg" for of in ("shared", "own"))
        subject = f"how {name!r} takes markers to be turned"
        advice = "better lenses, larger markers or a flatter board help"
        if "shared_place" in one:
            shared, own = (
                f"{words} and {1e3 * one[f'{of}_place']:.2f} mm"
                for of, words in (("shared", shared), ("own", own))
            )
            subject = f"what the controller says of {name!r}"
            advice = "record poses elsewhere in the workspace, or calibrate the arm itself"
        out.append(
            f"{subject} is off alike in poses alike, by {shared}, besides {own} of each pose's "
            f"own: error bars count it, and more poses like these tell little more; {advice}"
        )
    return out


def _set_aside(calibration: TreeCalibration) -> NDArray:
    """Return of which samples something was set aside, or a joint was read wrongly. (P,)."""
    data, solution = calibration.data, calibration.solution
    table = data.observations
    aside = np.array(solution.slipped_in(data.visit).any(axis=1))
    aside[table.pose[solution.outliers & (table.pose != ANY_POSE)]] = True
    return aside


def _outlier_words(calibration: TreeCalibration) -> list[str]:
    """Name sights of which all contradicts the rest, and markers of other such observations."""
    table, outliers = calibration.data.observations, calibration.solution.outliers
    sights, whole = _sights_off(calibration.data, outliers)
    single = table.marker[outliers & ~whole]
    counts = np.bincount(single, minlength=len(calibration.data.markers))
    named = sights + [
        f"{marker.name} ({count})"
        for marker, count in zip(calibration.data.markers, counts.tolist(), strict=True)
        if count >= _OUTLIERS_NAMED
    ]
    if not named:
        return []
    which = " and which mirror they were seen in" if any(table.mirror[whole]) else ""
    return [
        f"{int(outliers.sum())} of {len(table)} observations contradict the rest and were left "
        f"out: {listed(named)}; check their labels{which}"
    ]


def distance_words(calibration: TreeCalibration) -> list[str]:
    """Name known distances that contradict the rest."""
    data, outliers = calibration.data, calibration.solution.outliers
    table, far, said = data.observations, calibration.train.by_row(), list[str]()
    kinds = np.array([sensor.kind for sensor in data.sensors])
    for row in np.flatnonzero(outliers & (kinds[table.sensor] == DISTANCE)).tolist():
        pair = " and ".join(data.markers[i].name for i in (table.marker[row], table.other[row]))
        when = "" if table.pose[row] == ANY_POSE else f" in sample {data.sample[table.pose[row]]}"
        told = f"told {1e3 * table.values[row, 0]:.1f} mm, off by {1e3 * far[row]:.1f} mm"
        said.append(f"{pair}{when} ({told})")
    if not said:
        return []
    return [f"distances contradict the rest and were left out: {listed(said)}; measure them again"]


def _sights_off(data: BodyDataset, outliers: NDArray) -> tuple[list[str], NDArray]:
    """Return sights of several markers of which none was kept, in words, and their rows."""
    table, mirrors = data.observations, ("", *data.mirrors)
    told = np.array([data.sensors[s].kind in SIGHTS for s in table.sensor])
    of = np.stack([table.pose, table.sensor, np.searchsorted(mirrors, table.mirror)], axis=1)
    sights, number, count = np.unique(of, axis=0, return_inverse=True, return_counts=True)
    number = number.ravel()
    gone = np.bincount(number, outliers & told, minlength=len(sights)) == count
    off = gone & (count >= _WHOLE_SIGHT)
    words = [
        f"all that {data.sensors[sensor].name!r} saw in "
        f"{f'mirror {mirrors[mirror]!r} in ' if mirror else ''}sample {data.sample[pose]}"
        for pose, sensor, mirror in sights[off].tolist()
    ]
    return words, off[number]
