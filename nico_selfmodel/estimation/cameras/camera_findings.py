"""What speaks for and against cameras that were learned from boards."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import EstimationError, ModelError
from nico_selfmodel.estimation.cameras.board_accuracy import (
    beyond_learned,
    from_centre,
    held_out_residuals,
)
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.cameras.camera_assessment import (
    CameraAssessment,
    fails_the_lens,
)
from nico_selfmodel.estimation.cameras.lacks.lack_words import words_of_lack
from nico_selfmodel.estimation.cameras.lenses.lens_folds import folds_by_chance, folds_of
from nico_selfmodel.estimation.results.calibration_result import (
    FAILURE,
    LAST,
    NOTE,
    OPEN,
    WARNING,
    Finding,
    findings,
)
from nico_selfmodel.model.cameras.projection import POLYNOMIAL, RATIONAL
from nico_selfmodel.names import listed

_EXCESSIVE = 3.0
"""Ratio of root mean squares that needs no statistics: of a handful of boards, or one wrong one."""
NOTABLE_APART, LARGEST_APART = 1.2, 1.5
"""Noise of boards in all cameras together over that in each by itself, from which on it is
mentioned, and no noise."""
_SHOWN = 3
_EXACT = 1e-6
"""Noise of corners below which there is none [px]."""
_WORST_PX, _WORST = 6.0, 20.0
"""A corner further off than both, in pixels and in standard deviations, is no corner of the board:
a detector's corner lies within, whatever its window holds."""


def camera_findings(assessment: CameraAssessment) -> tuple[Finding, ...]:
    """Return what speaks for and against cameras beyond what every calibration is asked."""
    far, judged = _far_out(assessment)
    failures = [
        *(words_of_lack(lack) for lack in assessment.lacks if lack.fails),
        *_lens_reasons(assessment),
        _better_lens(assessment),
        _beyond_reach(assessment),
        far,
        _worst_reason(judged),
        *_fold_reasons(assessment),
    ]
    said, distances = [], assessment.test_distances
    if distances is not None and assessment.test_views is not None:
        rms, boards = np.sqrt(np.mean(distances**2)), len(assessment.test_views)
        said = [f"{rms:.3f} px rms on {boards} boards that were held out"]
    if assessment.decentred:
        said.append(
            f"decentred: p1 and p2 of {listed(assessment.decentred)} explain what residuals have "
            "in common over the image; both were let move"
            f"{' in all cameras' if len(assessment.calibration.cameras) > 1 else ''}"
        )
    return (
        *findings(FAILURE, failures),
        *boards_apart(assessment.calibration),
        *findings(LAST, [_excess_reason(judged)]),
        *_rival_lens(assessment),
        *findings(WARNING, (words_of_lack(lack) for lack in assessment.lacks if not lack.fails)),
        *findings(WARNING, assessment.warnings),
        *findings(NOTE, said),
    )


def _lens_reasons(assessment: CameraAssessment) -> list[str]:
    """Say which lenses bend light as their model does not, unless the board or a zoom is why."""
    if any(lack.fails and lack.bends_images for lack in assessment.lacks):
        return []
    return [assessment.words_of(m) for m in assessment.misfits if fails_the_lens(m)]


def _better_lens(assessment: CameraAssessment) -> str | None:
    """Say that another lens than the one asked for meets unseen boards better."""
    if assessment.better_lens is None:
        return None
    return (
        f"boards are met better by a {assessment.better_lens} lens than by the "
        f"{assessment.lens} one that was asked for: let the boards choose with --lens auto"
    )


def _beyond_reach(assessment: CameraAssessment) -> str | None:
    """Say which held-out boards lie where the learned lens sees nothing."""
    if not assessment.beyond_reach:
        return None
    boards, many = assessment.beyond_reach, len(assessment.beyond_reach) > 1
    or_else = "" if assessment.lens_by_boards else ", or let the boards choose with --lens auto"
    return (
        f"held-out {'boards' if many else 'board'} {listed(boards)} {'lie' if many else 'lies'} "
        f"where the learned {assessment.lens} lens has ended: learn from boards that reach as far"
        f"{or_else}"
    )


def _rival_lens(assessment: CameraAssessment) -> list[Finding]:
    """Say that boards leave open whether the lens is the one asked for."""
    lens, rival = assessment.lens, assessment.rival_lens
    if rival is None:
        return []
    if (lens, rival) == (RATIONAL, POLYNOMIAL):  # a polynomial is a rational lens, too
        text = f"a {rival} lens, which --lens auto takes, explains these boards as well"
        return findings(WARNING, [f"{text} with fewer numbers"])
    text = f"these boards do not tell the {lens} lens that was asked for from a {rival} one"
    return findings(
        OPEN,
        [
            f"{text}, which explains them as well: bring the board nearer to the image's edges, or "
            "let the boards choose with --lens auto"
        ],
    )


def _far_out(assessment: CameraAssessment) -> tuple[str | None, CameraAssessment]:
    """Say where held-out corners miss only because no board learned from reached as far out.

    Returns:
        What to say, if so, and what is left to be judged: without these corners, if so.
    """
    test, calibration = assessment.test_views, assessment.calibration
    if test is None or not (_worst_reason(assessment) or _excess_reason(assessment)):
        return None, assessment
    beyond = beyond_learned(calibration, test)
    pixels = np.where(np.repeat(np.swapaxes(beyond, 1, 2), 2, axis=2), np.nan, test.pixels)
    inner = replace(test, pixels=pixels).placeable()
    if not beyond.any() or not len(inner):
        return None, assessment
    try:
        left = held_out_residuals(calibration.cameras, inner)
    except (EstimationError, ModelError):
        return None, assessment
    judged = replace(assessment, test_views=inner, test_residuals=left)
    if _worst_reason(judged) or _excess_reason(judged):
        return None, assessment
    return _words_of_far(assessment, test, beyond), judged


def _words_of_far(assessment: CameraAssessment, test: BoardViews, beyond: NDArray) -> str:
    """Say which boards lie how far out, in the camera where they lie furthest."""
    calibration = assessment.calibration
    learned = calibration.views.select(~calibration.outliers)
    most = int(np.argmax(beyond.sum(axis=(0, 2))))
    name, camera = test.cameras[most], calibration.cameras[most]
    out = np.where(beyond[:, most], from_centre(camera, test.of_camera(name)), 0.0)
    reach = float(np.nanmax(from_centre(camera, learned.of_camera(name))))
    boards = [test.names[v] for v in np.flatnonzero(out.any(axis=1))]
    return (
        f"corners of held-out {'boards' if len(boards) > 1 else 'board'} {listed(boards)} lie up "
        f"to {out.max():.0f} px from the centre of the {name} image, corners learned from up to "
        f"{reach:.0f} px: the {assessment.lens_of(name)} lens is told no further out and misses "
        "them there, all others fit; learn from boards that reach as far"
    )


def boards_apart(calibration: CameraCalibration) -> list[Finding]:
    """Say where boards fit each camera by itself and not all together.

    The mean over views of the ratio of both mean squares, one corner that is far off being in both.
    """
    seen = calibration.views.seen
    shared = ~calibration.outliers & (seen.any(axis=2).sum(axis=1) > 1)
    count = 2.0 * seen.sum(axis=2)[shared]
    together, alone = (calibration.view_alone[shared][:, :, k] for k in (0, 1))
    ratio = together / count / np.maximum(alone / np.maximum(count - 6.0, 1.0), _EXACT**2)
    told = np.isfinite(ratio)
    apart = float(np.sqrt(np.mean(ratio[told]))) if told.any() else 0.0
    if apart < NOTABLE_APART:
        return []
    worst = np.argsort(-np.nanmax(np.where(told, ratio, 0.0), axis=1), kind="stable")
    names = [calibration.views.names[v] for v in np.flatnonzero(shared)[worst][:_SHOWN]]
    one, all_ = (np.sqrt(np.median(s[told] / count[told])) for s in (alone, together))
    text = (
        f"each camera by itself fits boards to {one:.2g} px, all together to {all_:.2g} px, worst "
        f"{listed(names)}: did the cameras keep still against each other, and are all pictures of "
        "one size, uncropped, and of one moment?"
    )
    return findings(FAILURE if apart >= LARGEST_APART else WARNING, [text])


def _worst_reason(assessment: CameraAssessment) -> str | None:
    """Say where a corner of an inlier or held-out board is none."""
    calibration = assessment.calibration
    sigma = float(np.median(assessment.train_distances)) / np.sqrt(2.0 * np.log(2.0))
    shown = [("", calibration.views.names, calibration.distances, ~calibration.outliers)]
    if assessment.test_views is not None and assessment.test_residuals is not None:
        names, r = assessment.test_views.names, assessment.test_residuals
        pairs = np.linalg.norm(r.reshape(len(r), -1, r.shape[2] // 2, 2), axis=3)
        everything = np.ones(len(r), dtype=bool)
        shown.append(("held-out ", names, np.moveaxis(pairs, 2, 1), everything))
    for kind, names, distances, counts in shown:
        worst = np.where(counts, np.nanmax(distances, axis=(1, 2), initial=0.0), 0.0)
        view = int(np.argmax(worst))
        if worst[view] > max(_WORST_PX, _WORST * sigma):
            return (
                f"a corner of {kind}board {names[view]} lies {worst[view]:.1f} px off, typical are "
                f"{sigma:.2f}: is it a plain chessboard (no ChArUco board), flat and sharp"
                f"{'' if assessment.lens_by_boards else ', and the lens no other (--lens auto)'}?"
            )
    return None


def _fold_reasons(assessment: CameraAssessment) -> list[str]:
    """Say where a lens folds its image and the boards say so; what is by chance is a warning."""
    calibration = assessment.calibration
    views, by_chance = calibration.views, folds_by_chance(calibration)
    folds = folds_of(views.cameras, calibration.cameras)
    if any(map(fails_the_lens, assessment.misfits)):
        return [fold.partition(": ")[0] for fold in folds.values()]  # pins would cure nothing
    return [fold for camera, fold in folds.items() if camera not in by_chance]


def _excess_reason(assessment: CameraAssessment) -> str | None:
    """Say when held-out boards fit so much worse that a handful of them suffices to know."""
    if assessment.test_residuals is None or len(assessment.left_out_residuals) == 0:
        return None
    found = rms_of_boards(assessment.test_residuals)
    expected = rms_of_boards(assessment.left_out_residuals)
    rms, before = (float(np.sqrt(np.mean(r**2))) for r in (found, expected))
    if rms < _EXCESSIVE * before:
        return None
    return (
        f"held-out boards fit to {rms:.3f} px rms, cross-validated ones to {before:.3f} px: some "
        "of them contradict the others"
    )


def rms_of_boards(residuals: NDArray) -> NDArray:
    """Return the root mean square error of each board [px]. Shape (V, P, 2 C) -> (V,)."""
    return np.sqrt(2.0 * np.nanmean(residuals**2, axis=(1, 2)))
