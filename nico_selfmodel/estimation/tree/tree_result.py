"""A body learned from any sensors as the result of a calibration."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_folder import body_content_hash
from nico_selfmodel.estimation.bending.what_bends import bending_json
from nico_selfmodel.estimation.results.calibration_result import (
    CalibrationResult,
    Errors,
    Parameter,
    Terms,
    finite,
    parameter_table,
)
from nico_selfmodel.estimation.results.provenance import package_versions
from nico_selfmodel.estimation.results.unobservable_words import name_unobservable
from nico_selfmodel.estimation.tree.compared_errors import (
    COMPARED,
    errors_of_tree,
    expected_errors,
    held_beside_crossed,
)
from nico_selfmodel.estimation.tree.contradictions.unplaced_markers import in_the_middle
from nico_selfmodel.estimation.tree.guesses.hand_eye import only_axis
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
from nico_selfmodel.estimation.tree.tree_findings import SCALE, alike_errors, tree_findings
from nico_selfmodel.estimation.tree.tree_parameters import SHIFTS, TURNS
from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import FLANGE, FREE, REVOLUTE, WHOLE_POSES
from nico_selfmodel.model.tree.free_joints import body_alone
from nico_selfmodel.names import listed
from nico_selfmodel.optimization.uncertainty import UNKNOWN_SIGMA, UnobservableDirection

_ALIGNED = 0.95
"""Cosine of an open way with an axis from which on it is along it."""
_NOTHING = 0.01
"""Fall of half the squared residuals in a step that moves nothing by more than a seventh sigma."""
_TERMS = Terms(
    outlier_cause="body, sensors, or what was recorded are not what the data set says",
    worse_cause="something changed between the recordings, or the body bends",
)


def tree_result(calibration: TreeCalibration) -> CalibrationResult:
    """Return a body with all that it is judged by and that is written down of it."""
    solution, data = calibration.solution, calibration.data
    crossed, held = calibration.cross_validation, calibration.test
    # Both are told in units of what is usual, or neither.
    usual_test = None if calibration.usual is None else calibration.usual_test
    test = None if held is None else errors_of_tree(held, usual=usual_test)
    among = COMPARED if test is None else (test.compared_by,)
    usual = None if test is not None and test.relative_to is None else calibration.usual
    inliers = ~solution.outliers
    poses = data.observations.pose[solution.outliers]
    too: tuple[tuple[Errors, Errors], ...] = ()
    if held is not None and test is not None and crossed is not None:
        both = (usual_test, usual) if usual is not None else (None, None)
        too = held_beside_crossed(held, crossed, inliers, both, test.compared_by)
    return CalibrationResult(
        method="tree",
        parameters=_parameters(calibration),
        train=errors_of_tree(calibration.train, inliers),
        test=test,
        cross_validation=None
        if crossed is None
        else errors_of_tree(crossed, inliers, among, usual),
        compared_too=too,
        outliers=solution.outliers,
        outlier_names=tuple(sorted(set(data.sample[poses[poses >= 0]].tolist()))),
        unobservable=_unobservable(calibration),
        converged=_converged(calibration),
        iterations=solution.iterations,
        seconds=calibration.seconds,
        findings=tree_findings(calibration),
        details=_details(calibration),
        terms=_TERMS,
    )


def _converged(calibration: TreeCalibration) -> bool:
    """Whether it reached a minimum, or no more than crept along what nothing determines."""
    solution, open_ways = calibration.solution, calibration.uncertainty.unobservable
    falls = -np.diff(solution.history[-2:])
    return solution.converged or (bool(open_ways) and bool((falls < _NOTHING).all()))


def body_model(calibration: TreeCalibration) -> BodyModel:
    """Return what is kept of a calibration: the body with its error bars."""
    data = calibration.data
    provenance: dict[str, Any] = {
        "dataset": data.name,
        "dataset_sha256": body_content_hash(data),
        "start": calibration.label,
        "world": calibration.setup.world,
        "scale_from": calibration.setup.scale_from or "nothing",
        **package_versions("drake"),
    }
    if data.seed is not None:
        provenance["seed"] = data.seed
    tree = in_the_middle(body_alone(calibration.tree), calibration.unplaced)
    joints = data.joints[: len(tree.joints)]
    # Of boards nothing is estimated but what bends, which is nothing.
    boards = tuple(f"{data.joints[i].name}." for i in data.free_joints)
    names, matrix = _with_scale(calibration)
    kept = [i for i, name in enumerate(names) if not name.startswith(boards or "\0")]
    # A body's parameters are told from its own frames, those of a description from its.
    retold = calibration.parameters.retold(calibration.values, names)
    covariance = retold @ matrix @ retold.T
    return BodyModel(
        calibration.name,
        tree,
        np.array([joint.si_per_unit for joint in joints]),
        ParameterCovariance(tuple(names[i] for i in kept), covariance[np.ix_(kept, kept)]),
        calibration.noise,
        expected_errors(
            calibration.cross_validation or calibration.train,
            ~calibration.solution.outliers,
            calibration.usual,
        ),
        provenance,
        np.array(
            [
                [-np.inf if joint.lower is None else joint.lower for joint in joints],
                [np.inf if joint.upper is None else joint.upper for joint in joints],
            ]
        ),
    )


def _with_scale(calibration: TreeCalibration) -> tuple[tuple[str, ...], NDArray]:
    """Return the covariance of what was free, and of all lengths where nothing tells these.

    Markers that were seen too seldom may be anywhere.
    """
    known, parameters = calibration.uncertainty, calibration.parameters
    far = [f"{name}.{part}" for name in calibration.unplaced for part in SHIFTS]
    nowhere = [name for name in far if name not in known.names]
    way = parameters.by_scale(calibration.values)
    if calibration.setup.scale_from is not None:
        way = np.zeros(len(way))
    held = [n for n in np.array(parameters.names)[way != 0.0].tolist() if n not in known.names]
    ours, others = (way[[parameters.index[n] for n in names]] for names in (known.names, held))
    across = np.outer(others, ours)
    anywhere = (UNKNOWN_SIGMA * calibration.size) ** 2
    matrix = anywhere * np.eye(len(known.names) + len(held) + len(nowhere))
    told = len(matrix) - len(nowhere)
    matrix[:told, :told] = np.block(
        [[known.covariance, across.T], [across, np.outer(others, others)]]
    )
    names = (*known.names, *held, *nowhere)
    lost = np.isin(names, far)
    matrix[lost], matrix[:, lost] = 0.0, 0.0
    matrix[lost, lost] = anywhere
    return names, matrix


def _parameters(calibration: TreeCalibration) -> dict[str, Parameter]:
    """Return what was estimated, then what was held at a value of its own."""
    parameters, uncertainty = calibration.parameters, calibration.uncertainty
    sigma = dict(zip(uncertainty.names, uncertainty.sigma.tolist(), strict=True))
    table = parameter_table(parameters.names, calibration.values, parameters.units, sigma)
    kept = set(calibration.setup.fixed)
    return {n: known for n, known in table.items() if known.free or n in kept}


def _unobservable(calibration: TreeCalibration) -> tuple[str, ...]:
    open_ways = calibration.uncertainty.unobservable
    words = [
        _along_one_axis(calibration, direction)
        or f"{name_unobservable(direction)}: record poses that move it apart from the others, or "
        f"fix `{direction.names[0]}`{_endless(calibration)}"
        for direction, by_none in zip(open_ways, calibration.told_by_no_pose, strict=True)
        if not by_none and not _frames_of(direction) <= calibration.unplaced.keys()
    ]
    words = list(dict.fromkeys(words))
    return tuple(words if calibration.setup.scale_from is not None else [SCALE, *words])


def _frames_of(direction: UnobservableDirection) -> set[str]:
    return {name.rpartition(".")[0] for name in direction.names}


def _endless(calibration: TreeCalibration) -> str:
    """Say that joints of which limits are not known may be moved further; empty without any."""
    joints = [j for j in calibration.data.joints if not j.follows]
    if any(j.motion in WHOLE_POSES for j in joints):
        return ""
    names = [f"{j.name!r}" for j in joints if j.lower is None or j.upper is None]
    if not names:
        return ""
    return (
        f"; if {listed(names)} can go no further than was recorded, say so (`lower` and `upper` in "
        "dataset.yaml): what no pose tells is no failure"
    )


def _along_one_axis(calibration: TreeCalibration, direction: UnobservableDirection) -> str:
    """Say what is open because a flange only turns about one axis; empty where that is not why."""
    data, tree = calibration.data, calibration.tree
    for i, (name, motion) in enumerate(zip(tree.joints, tree.motions, strict=True)):
        axis = only_axis(data.X_flange[:, i]) if motion == FLANGE else None
        if axis is None:
            continue
        along = data.X_flange[0, i, :3, :3].T @ axis
        for item in tree.attached:
            how = _moved_along(direction, item.name, along) if item.on == i else ""
            if how:
                x, y, z = (axis.round(2) + 0.0).tolist()  # never -0.00
                return (
                    f"all turns of {name!r} are about one axis, ({x:.2f}, {y:.2f}, {z:.2f}) in its "
                    f"base: how far {item.name!r} is {how} cannot be told from where "
                    f"{calibration.setup.world!r} is: record poses that are turned about a second "
                    "axis, by 30 deg or more"
                )
    return ""


def _moved_along(direction: UnobservableDirection, item: str, axis: NDArray) -> str:
    """Return how an open direction moves what a flange carries; empty where it does not."""
    shares = dict(zip(direction.names, direction.shares.tolist(), strict=True))
    shift, turn = (np.array([shares.get(f"{item}.{part}", 0.0) for part in parts])
                   for parts in (SHIFTS, TURNS))  # fmt: skip
    if not (shift.any() or turn.any()):
        return ""
    if not turn.any() and abs(shift @ axis) > _ALIGNED * np.linalg.norm(shift):
        return "shifted along it"
    if not shift.any() and abs(turn @ axis) > _ALIGNED * np.linalg.norm(turn):
        return "turned about it"
    return "shifted along it and turned about it"


def _details(calibration: TreeCalibration) -> dict[str, Any]:
    solution, described = calibration.solution, calibration.described
    slipped = solution.slipped.sum(axis=0)
    joints = calibration.data.joints
    observations = calibration.train.observations
    return {
        "world": calibration.setup.world,
        "scale_from": calibration.setup.scale_from,
        "start": {
            "from": calibration.label,
            "tried": calibration.starts,
            "agreeing": calibration.agreeing,
        },
        "noise": dict(calibration.noise),
        "noise_known": solution.variances_known,
        "alike_errors": alike_errors(calibration),
        "slips": {
            joints[i].name: count
            for (i, part), count in zip(observations.noisy_joints, slipped.tolist(), strict=True)
            if part == 0 and joints[i].motion != FREE
        },
        "joints": _joints(calibration),
        **_mirrors(calibration),
        **_touches(calibration),
        "described": None if described is None else errors_of_tree(described).to_json(),
        "description_off": _description_off(calibration),
        "changes": _changes(calibration),
        "bending": bending_json(
            calibration.ladder, calibration.tree.bending, calibration.at, calibration.tree.joints
        ),
    }


def _mirrors(calibration: TreeCalibration) -> dict[str, Any]:
    """Return the mirrors in which something was seen; nothing where there was none."""
    data, uncertainty = calibration.data, calibration.uncertainty
    table, out = data.observations, {}
    for name in data.mirrors:
        test = calibration.flatness.get(name)
        mirror = calibration.tree.mirror(name)
        free = [n for n in mirror.names if n in uncertainty.names]
        slopes = np.zeros((4, len(uncertainty.names)))
        own = [uncertainty.names.index(n) for n in free]
        slopes[:, own] = mirror.slopes[:, [mirror.names.index(n) for n in free]]
        *turns, shift = (uncertainty.sigma_of(slope) for slope in slopes)
        poses = np.unique(data.pose[table.pose[table.mirror == name]])
        out[name] = {
            "poses": len(poses),
            "normal": mirror.plane.normal.tolist(),
            "normal_sigma_deg": finite(float(np.degrees(np.linalg.norm(turns)))),
            "distance_mm": 1e3 * mirror.plane.offset,
            "distance_sigma_mm": finite(shift, 1e3),
            "distance_from": "the world's origin",
            "flatness": None if test is None else test.to_json(),
        }
    return {"mirrors": out} if out else {}


def _touches(calibration: TreeCalibration) -> dict[str, Any]:
    """Return by how much touches and distances are missed, and the planes; nothing without any."""
    test = {} if calibration.test is None else calibration.test.of_touches()
    out: dict[str, dict[str, Any]] = {}
    for name, left in calibration.train.of_touches(~calibration.solution.outliers).items():
        out[name] = {"n": len(left), "rms_mm": _rms_mm(left)}
        if name in test:
            out[name] |= {"test_n": len(test[name]), "test_rms_mm": _rms_mm(test[name])}
    for plane in calibration.tree.planes:
        normal = plane.X_LA[:3, 2]
        distance_mm = 1e3 * float(normal @ plane.X_LA[:3, 3])
        out.get(plane.name, {}).update(normal=normal.tolist(), distance_mm=distance_mm)
    return {"touches": out} if out else {}


def _rms_mm(left: NDArray) -> float:
    return 1e3 * float(np.sqrt(np.mean(left**2)))


def _joints(calibration: TreeCalibration) -> list[dict[str, Any]]:
    """Return the tree: what carries each joint, and its axis against the axis that carries it."""
    tree = calibration.tree
    return [
        {
            "name": name,
            "parent": tree.link_name(parent),
            "motion": motion,
            **_axes(X, motion, tree.motions[parent] if parent >= 0 else FLANGE),
            "markers": [m.name for m in tree.markers if m.on == i],
            "sensors": [s.name for s in tree.sensors if s.on == i],
        }
        for i, (name, parent, motion, X) in enumerate(
            zip(tree.joints, tree.parent.tolist(), tree.motions, tree.X_PJ, strict=True)
        )
    ]


def _axes(X_PJ: NDArray, motion: str, before: str) -> dict[str, float | None]:
    """Return angle and distance of a joint's axis and its parent's z; nothing at a root.

    What shifts has a direction and no place.
    """
    if {motion, before} & set(WHOLE_POSES):
        return {"axis_angle_deg": None, "axis_distance_mm": None}
    z, p = X_PJ[:3, 2], X_PJ[:3, 3]
    normal = np.array([-z[1], z[0], 0.0])
    sine = float(np.linalg.norm(normal))
    apart = abs(float(p @ normal)) / sine if sine > 1e-6 else float(np.hypot(p[0], p[1]))
    angle = float(np.degrees(np.arctan2(sine, z[2])))
    placed = motion == before == REVOLUTE
    return {"axis_angle_deg": angle, "axis_distance_mm": 1e3 * apart if placed else None}


def _description_off(calibration: TreeCalibration) -> dict[str, Any] | None:
    """Return how far frames of a description are off, by the priors that the solution has."""
    description = calibration.description
    if description is None:
        return None
    priors = calibration.ladder.solution.problem.priors
    sigmas = [description.turn_sigma, description.shift_sigma]
    for k, alike in enumerate(calibration.setup.alike):
        sigmas[k] = next((priors[name][1] for name in alike.names if name in priors), sigmas[k])
    return {
        "turn_sigma_deg": float(np.degrees(sigmas[0])),
        "shift_sigma_mm": 1e3 * sigmas[1],
        "learned": bool(calibration.setup.alike),
    }


def _changes(calibration: TreeCalibration) -> dict[str, Any]:
    """Return how far each joint is from its description: turn and shift with their sigmas."""
    if calibration.description is None:
        return {}
    uncertainty, index = calibration.uncertainty, calibration.parameters.index
    sigma = dict(zip(uncertainty.names, uncertainty.sigma.tolist(), strict=True))
    out = {}
    for joint in calibration.tree.joints:
        names = [f"{joint}.{part}" for part in ("rx", "ry", "rz", "x", "y", "z")]
        if names[0] not in sigma:
            continue
        values = calibration.values[[index[name] for name in names]]
        errors = np.array([sigma.get(name, 0.0) for name in names])
        out[joint] = {
            "turn_deg": float(np.degrees(np.linalg.norm(values[:3]))),
            "turn_sigma_deg": finite(float(np.degrees(np.linalg.norm(errors[:3])))),
            "shift_mm": float(1e3 * np.linalg.norm(values[3:])),
            "shift_sigma_mm": finite(float(1e3 * np.linalg.norm(errors[3:]))),
        }
    return out
