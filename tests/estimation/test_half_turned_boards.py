"""Boards that equal themselves half a turn on, before cameras that are rolled."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.cameras.lenses.lens_choice import lens_of
from nico_selfmodel.estimation.cameras.parts_of_boards import turned_to_fit, with_half_turns

from ..slow_rest import slow_rest
from .simulated_boards import GRID, RIG, boards, pictures

EVEN = GRID[:, 0] < 8.0
"""Corners of a board of 8 x 6, which is the same half a turn on; one of 9 x 6 is not."""
PLAIN = CameraOptions()


def of_even_boards(views):
    """Return what is seen of a board of 8 x 6."""
    return replace(views, p_GQ=views.p_GQ[EVEN], pixels=views.pixels[:, EVEN])


def numbered_from_the_end(views, rows):
    """Return views in which the right camera numbers corners of some boards from the other end."""
    pixels = views.pixels.copy()
    pixels[rows, :, 2:] = pixels[rows, ::-1, 2:]
    return replace(views, pixels=pixels)


@pytest.mark.parametrize("seed", slow_rest(range(3), 1))
@pytest.mark.parametrize("every", [1, 2])
def test_a_pair_of_which_one_camera_is_rolled_is_learned_with_boards_half_a_turn_on(seed, every):
    views = of_even_boards(pictures(boards(14, seed), 0.2, seed))
    rolled = numbered_from_the_end(views, np.arange(14) % every == 0)
    learned, test = rolled.select(np.arange(11)), rolled.select(np.arange(11, 14))
    choice = lens_of(learned, PLAIN)
    assert choice.calibration.rig.baseline == pytest.approx(RIG.baseline, rel=0.02)
    assert not choice.calibration.outliers.any()
    assert choice.calibration.rms < 0.4
    assessment = CameraAssessment.from_calibration(choice.calibration, PLAIN, test)
    assert np.sqrt(np.mean(assessment.test_distances**2)) < 0.4


def test_boards_that_are_something_else_half_a_turn_on_are_never_turned():
    views = pictures(boards(8), 0.2)
    assert with_half_turns(views) is None
    assert with_half_turns(of_even_boards(views).only("left")) is None
    assert turned_to_fit(views, RIG.cameras) is views
    with pytest.raises(EstimationError, match="no rigid pair"):
        lens_of(numbered_from_the_end(views, np.arange(8)), PLAIN)


def test_only_boards_that_fit_half_a_turn_on_are_turned():
    views = of_even_boards(pictures(boards(6), 0.2))
    rolled = numbered_from_the_end(views, [1, 4])
    assert np.array_equal(turned_to_fit(views, RIG.cameras).pixels, views.pixels)
    assert np.array_equal(turned_to_fit(rolled, RIG.cameras).pixels, views.pixels)
    other = views.pixels.copy()
    other[[2, 3]] = other[[3, 2]]
    other[[2, 3], :, :2] = views.pixels[[2, 3], :, :2]
    mixed = replace(views, pixels=other)
    assert np.array_equal(
        turned_to_fit(mixed, RIG.cameras).pixels[[0, 1, 4, 5]], other[[0, 1, 4, 5]]
    )


def test_pairs_that_do_not_belong_together_are_refused_as_before():
    views = of_even_boards(pictures(boards(10), 0.2))
    pixels = views.pixels.copy()
    pixels[:, :, 2:] = np.roll(pixels[:, :, 2:], 3, axis=0)
    with pytest.raises(EstimationError, match="no rigid pair"):
        lens_of(replace(views, pixels=pixels), PLAIN)


def test_boards_are_not_turned_where_some_pictures_belong_to_no_other():
    views = of_even_boards(pictures(boards(10), 0.2))
    pixels = numbered_from_the_end(views, np.arange(10)).pixels.copy()
    pixels[[2, 5], :, 2:] = pixels[[5, 2], :, 2:]
    with pytest.raises(EstimationError, match="no rigid pair"):
        lens_of(replace(views, pixels=pixels), PLAIN)
