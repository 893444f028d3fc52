"""Which lens boards tell: the polynomial, unless boards that were left out say otherwise.

The polynomial of three coefficients stays where its residuals have nothing notable in common over
the image. Where they have, or no such camera fits at all, the rational lens and the fisheye are
tried: each board is predicted by cameras that were learned without it, and a lens must lower the
mean over boards of log(rms) by more than 1 % and two standard errors. Of those that do as well the
one stays under which the corners learned from are likeliest, each number that they need counted as
a unit of the logarithm (Akaike 1974), unless its residuals still have something in common, or it
folds the image. Where the last coefficients fold it and boards do no worse without, they are left
out; so they are where a rational lens ends before light does, and corners do not need them. A lens
that was asked for is wrong where another one is far likelier, by the same measure.

Where p1 and p2, held at zero, would explain more of the residuals than chance does, all is tried
with both free, too: the lens is decentred if boards that were left out gain by that (`gains_by`).
Where the polynomial with both leaves nothing in common and gains, no other lens is tried.

Cameras of a rig have one lens, unless they are not alike: images of other sizes, or angles of view
that differ by a fifth. Then the lenses that the boards of each camera by itself tell stand for
choice, too.

Where cameras are no rigid pair, and their board equals itself half a turn on, all is tried with it
half a turn on in some of them: they may be rolled against each other.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import EstimationError, ModelError
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import AUTO, CameraOptions, lens_word
from nico_selfmodel.estimation.cameras.lenses.lens_evidence import (
    LensEvidence,
    asks_for_others,
    evidence_of,
    gains_by,
    is_likelier,
    is_wrong,
    leaves_doubt,
    misfits_of,
    needed_of,
)
from nico_selfmodel.estimation.cameras.parts_of_boards import told_places, with_half_turns
from nico_selfmodel.estimation.results.calibration_result import finite
from nico_selfmodel.model.cameras.projection import FISHEYE, LENSES, POLYNOMIAL, RATIONAL
from nico_selfmodel.names import listed

_ALIKE = 0.2
"""Share by which focal lengths, in widths of the image, of one kind of camera may differ."""
_LIKE = {FISHEYE: (RATIONAL, 3.0), RATIONAL: (FISHEYE, -3.0)}
"""The lens that may be right in place of one that was asked for, and by how much it has to be less
likely: a logarithm, of 20 to 1 (Kass, Raftery 1995: 2 ln B = 6). Of rational lenses every fourth
bends light as a fisheye does as far as boards reach, of fisheyes one in twenty as a rational lens;
one that is likelier by as much is not taken only where it ends in front of the camera."""


@dataclass(frozen=True)
class LensTrial:
    """One lens, and what boards that were left out say of it."""

    lens: str
    """One of `LENSES`, or one each of cameras that are not alike, as `--lens` takes them."""
    left_out_px: float
    """Geometric mean over boards of their rms, each predicted without its fold [px]."""
    reason: str
    """Why it stayed or went."""


@dataclass(frozen=True, eq=False)
class LensChoice:
    """The lens that was taken."""

    options: CameraOptions
    """With this lens; its last coefficient held at zero where it folds the image for nothing."""
    calibration: CameraCalibration
    """The cameras that have it."""
    tried: tuple[LensTrial, ...] = ()
    """Those that were tried; empty where the polynomial leaves nothing to ask."""
    better: str | None = None
    """The lens by which unseen boards are met better than by the one that was asked for."""
    rival: str | None = None
    """The lens that boards do not tell from the one asked for, which they do not refuse."""
    decentred: tuple[str, ...] = ()
    """Cameras whose boards ask for p1 and p2; those of all cameras were let move then."""
    left_out: NDArray | None = None
    """What boards leave that were left out, where that was asked: `cross_validate_cameras`."""
    by_boards: bool = False
    """Whether the boards chose it: `AUTO`."""

    @property
    def lens(self) -> str:
        """One of `LENSES`, or one for each camera, as `--lens` takes them."""
        return lens_word(self.options.lens)

    def as_plain(self) -> dict[str, Any]:
        """Return it for `result.json`."""
        tried = [
            {"lens": t.lens, "left_out_px": finite(t.left_out_px), "reason": t.reason}
            for t in self.tried
        ]
        return {"kind": self.lens, "tried": tried, "decentred": list(self.decentred)}


def lens_of(views: BoardViews, options: CameraOptions) -> LensChoice:
    """Calibrate the cameras, with the lens that boards tell where `options` leaves it to them.

    Args:
        options: What is held and free; a lens other than `AUTO` is taken, and only compared.

    Raises:
        DataError, EstimationError, ModelError, ValueError: As `calibrate_cameras`, of the lens
            that was asked for, or where the boards can be learned from with no lens at all.
    """
    views = views.placeable()
    try:
        return _of_told(_told(views, options), options)
    except EstimationError:
        turned = with_half_turns(views)
        found = None if turned is None else _half_a_turn_on(turned, options)
        if found is None:
            raise
        return found


def _half_a_turn_on(views: BoardViews, options: CameraOptions) -> LensChoice | None:
    """Return the lens of cameras that have boards half a turn on; None where that is no cure.

    It is one where all of them fit then; pictures that belong to no other are no cause for it.
    """
    try:
        told = _told(views, options)
        return _of_told(told, options) if len(told) == len(views) else None
    except (EstimationError, ModelError):
        return None


def _of_told(views: BoardViews, options: CameraOptions) -> LensChoice:
    """Return the lens of cameras that have boards alike."""
    if options.lens != AUTO:
        return _compared(views, options)
    return replace(_chosen_by_boards(views, options), by_boards=True)


def _chosen_by_boards(views: BoardViews, options: CameraOptions) -> LensChoice:
    """Return the lens that boards tell, with p1 and p2 where they gain by these."""
    choice = _best_of(views, options)
    decentred = _decentred(views, options, choice)
    if not decentred:
        return choice
    near = choice.calibration if choice.lens == POLYNOMIAL else None
    freed = _best_of(views, replace(options, tangential=True), near)
    return _gaining(views, choice, replace(freed, decentred=decentred))


def _gaining(views: BoardViews, choice: LensChoice, freed: LensChoice) -> LensChoice:
    """Return the lens with p1 and p2 if boards that were left out gain by them, or without."""
    before, after = (evidence_of(views, one.options, one.calibration) for one in (choice, freed))
    if after is not None and (before is None or gains_by(before, after)):
        return replace(freed, left_out=after.residuals)
    return choice if before is None else replace(choice, left_out=before.residuals)


def _told(views: BoardViews, options: CameraOptions) -> BoardViews:
    """Return views in which parts of boards lie alike in all cameras, whichever lens they have."""
    if len(views.cameras) == 1 or not views.loose.any():
        return views
    placed = []
    for camera in views.cameras:
        found = lens_of(views.only(camera), _alone(options, camera)).calibration
        X_CG = np.full((len(views), 4, 4), np.nan)
        X_CG[[views.names.index(name) for name in found.views.names]] = found.X_LG
        placed.append((found.cameras[0], X_CG))
    return told_places(views, placed)[0]


def _alone(options: CameraOptions, camera: str) -> CameraOptions:
    """Return what concerns the inside of one camera."""
    if options.lens != AUTO:
        return options.of_camera(camera)
    # A rational lens has all numbers that an option may name.
    return replace(replace(options, lens=RATIONAL).of_camera(camera), lens=AUTO)


def _best_of(
    views: BoardViews, options: CameraOptions, near: CameraCalibration | None = None
) -> LensChoice:
    """Return the lens that boards tell, p1 and p2 free or held as the options say.

    Args:
        near: Cameras of the polynomial to begin with; found anew if omitted.
    """
    plain = replace(options, lens=POLYNOMIAL)
    try:
        found = calibrate_cameras(views, plain, near)
        if not asks_for_others(found, plain):
            return LensChoice(plain, found)
        moved = _only_decentred(views, options, LensChoice(plain, found))
        if moved is not None:
            return moved
    except (EstimationError, ModelError) as error:
        tried = _tried(views, options, (FISHEYE, RATIONAL))
        tried |= _tried_apart(views, options, tried)
        if not tried:
            raise
        return _chosen(tried, {POLYNOMIAL: LensTrial(POLYNOMIAL, np.nan, str(error))})
    tried = _tried(views, options, LENSES)
    tried |= _tried_apart(views, options, tried)
    return _chosen(tried, {}) if tried else LensChoice(plain, found)


def _only_decentred(
    views: BoardViews, options: CameraOptions, choice: LensChoice
) -> LensChoice | None:
    """Return the polynomial with p1 and p2 where they are all that its residuals ask for."""
    decentred = _decentred(views, options, choice)
    if not decentred:
        return None
    freed = replace(choice.options, tangential=True)
    try:
        found = calibrate_cameras(views, freed, choice.calibration)
    except (EstimationError, ModelError):
        return None
    if asks_for_others(found, freed):
        return None
    better = _gaining(views, choice, LensChoice(freed, found, decentred=decentred))
    return better if better.decentred else None


def _decentred(views: BoardViews, options: CameraOptions, choice: LensChoice) -> tuple[str, ...]:
    """Return cameras of which p1 and p2, held without having been asked for, are not zero.

    Fisheyes have neither: what the polynomial would do with them is asked.
    """
    if options.tangential or {"p1", "p2"} & {name[-2:] for name in options.pinned}:
        return ()
    if choice.lens != FISHEYE:
        misfits = misfits_of(choice.calibration, options)
        return tuple(misfit.camera for misfit in misfits if misfit.is_decentred)
    try:
        misfits = misfits_of(calibrate_cameras(views, replace(options, lens=POLYNOMIAL)), options)
    except (EstimationError, ModelError):
        return ()
    return tuple(misfit.camera for misfit in misfits if misfit.held[:1] == (f"{misfit.camera}.p1",))


def _compared(views: BoardViews, options: CameraOptions) -> LensChoice:
    """Return the lens that was asked for, and the one that unseen boards would rather have."""
    found = calibrate_cameras(views, options)
    asked = lens_word(options.lens)
    plain = asked == POLYNOMIAL and not asks_for_others(found, options)
    own = None if plain else needed_of(views, options, found)
    if own is None:
        return LensChoice(options, found)
    others = _tried(views, options, tuple(lens for lens in LENSES if lens != asked))
    others |= _tried_apart(views, replace(options, lens=AUTO), {asked: own, **others})
    others.pop(asked, None)
    better = [lens for lens, one in others.items() if not one.flawed and is_wrong(own, one)]
    trials = [_trial(asked, own, "asked for")] + [
        _trial(lens, one, "boards are met better" if lens in better else "no better")
        for lens, one in others.items()
    ]
    best = min(better, key=lambda lens: others[lens].mean, default=None)
    rival = None if best else _rival(asked, own, others)
    return LensChoice(
        own.options, own.calibration, tuple(trials), best, rival, left_out=own.residuals
    )


def _rival(asked: str, own: LensEvidence, others: dict[str, LensEvidence]) -> str | None:
    """Return the lens that would be taken in place of the one asked for, if another.

    Or that may be right in its place: `_LIKE`.
    """
    plain = others.get(POLYNOMIAL)
    if plain is not None and not asks_for_others(plain.calibration, plain.options):
        taken = POLYNOMIAL
    else:
        taken = _chosen({asked: own, **others}, {}).lens
    if taken != asked:
        return taken
    like, less = _LIKE.get(asked, (None, 0.0))
    return like if like in others and leaves_doubt(own, others[like], less) else None


def _trial(lens: str, found: LensEvidence, reason: str) -> LensTrial:
    if found.without:
        reason += f", without {listed(found.without)}, which the boards do not need"
    return LensTrial(lens, float(np.exp(found.mean)), reason)


def _tried(
    views: BoardViews, options: CameraOptions, lenses: tuple[str, ...]
) -> dict[str, LensEvidence]:
    """Return what each lens leaves that can be learned."""
    found = {lens: needed_of(views, replace(options, lens=lens)) for lens in lenses}
    return {lens: one for lens, one in found.items() if one is not None}


def _tried_apart(
    views: BoardViews, options: CameraOptions, tried: dict[str, LensEvidence]
) -> dict[str, LensEvidence]:
    """Return what lenses leave that the cameras' own boards choose; nothing of cameras alike."""
    best = min(tried.values(), key=lambda one: one.mean, default=None)
    if len(views.cameras) == 1 or (best is not None and _are_alike(best)):
        return {}
    choices = {}
    for camera in views.cameras:
        try:
            choices[camera] = lens_of(views.only(camera), _alone(options, camera)).options
        except (EstimationError, ModelError):
            return {}
    lenses = {camera: choice.lens for camera, choice in choices.items()}
    word = lens_word({camera: str(lens) for camera, lens in lenses.items()})
    if word in LENSES:
        return {}
    pinned = {
        (name if "." in name else f"{camera}.{name}"): value
        for camera, choice in choices.items()
        for name, value in choice.pinned.items()
    }
    whole = evidence_of(views, replace(options, lens=lenses, pinned={**options.pinned, **pinned}))
    return {} if whole is None else {word: whole}


def _are_alike(found: LensEvidence) -> bool:
    """Tell whether cameras may be of one kind: as large images, as wide views."""
    cameras = found.calibration.cameras
    focal = np.log([camera.fx / camera.image_size[0] for camera in cameras])
    return len({camera.image_size for camera in cameras}) == 1 and bool(np.ptp(focal) < _ALIKE)


def _chosen(found: dict[str, LensEvidence], failed: dict[str, LensTrial]) -> LensChoice:
    """Return the likeliest lens among those that do as well as the best."""
    best = min(found, key=lambda lens: found[lens].mean)
    apart = [lens for lens in found if lens not in LENSES]
    order = [lens for lens in (POLYNOMIAL, *apart, FISHEYE, RATIONAL) if lens in found]
    as_well = [lens for lens in order if not found[lens].worse_than(found[best])]
    clean = [lens for lens in as_well if not found[lens].flawed] or as_well
    taken = clean[0]
    for lens in clean[1:]:
        if is_likelier(found[lens], found[taken]):
            taken = lens
    trials = dict(failed)
    for lens in order:
        if lens == taken:
            why = "taken"
        elif lens not in as_well:
            why = "boards that were left out are met worse"
        elif found[lens].flawed:
            why = "it leaves a pattern over the image, folds it, or is not told by these boards"
        else:
            why = "boards tell no difference, and the corners are less likely"
        trials[lens] = _trial(lens, found[lens], why)
    own = found[taken]
    return LensChoice(own.options, own.calibration, tuple(trials.values()), left_out=own.residuals)
