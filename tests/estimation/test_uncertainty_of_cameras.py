"""What a calibration of cameras says of its own errors, against the errors of many recordings."""

import numpy as np
import pytest

from nico_selfmodel.estimation.cameras.board_accuracy import Reconstruction
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras

from .simulated_boards import RIG, boards, pictures

pytestmark = pytest.mark.slow
SIGMA = 0.2
BOARDS = 20


def scores(calibration):
    """Return the errors of the free parameters over their stated sigma."""
    error = (calibration.rig.values - RIG.values)[np.isin(RIG.names, calibration.names)]
    return error / calibration.uncertainty.sigma


def test_the_sigma_of_every_parameter_is_its_spread_over_200_recordings():
    X_LG = boards(BOARDS, 1)
    results = [calibrate_cameras(pictures(X_LG, SIGMA, seed)) for seed in range(200)]
    assert all(result.converged and not result.outliers.any() for result in results)
    z = np.array([scores(result) for result in results])
    assert z.shape == (200, 20)
    # Over 200 recordings a spread is known to a twentieth.
    spread = dict(zip(results[0].names, z.std(axis=0, ddof=1), strict=True))
    assert {name: s for name, s in spread.items() if not 0.85 <= s <= 1.15} == {}
    assert np.abs(z.mean(axis=0)).max() < 0.3
    noise = [result.pixel_sigma for result in results]
    assert np.mean(noise) == pytest.approx(SIGMA, rel=2e-3)


@pytest.fixture(scope="module")
def recordings():
    """Return what 20 recordings of different boards teach, and these boards."""
    views = [pictures(boards(BOARDS, seed), SIGMA, seed) for seed in range(20)]
    return [(calibrate_cameras(each), each) for each in views]


def test_errors_over_sigma_of_20_recordings_have_unit_spread(recordings):
    z = np.array([scores(result) for result, _ in recordings])
    assert 0.85 <= np.sqrt(np.mean(z**2)) <= 1.15


def test_the_scale_of_what_is_rebuilt_is_unbiased(recordings):
    scales = [Reconstruction.from_views(c.rig, views).scale.mean() for c, views in recordings]
    assert np.mean(scales) == pytest.approx(1.0, abs=5e-4)
    # Boards that were not learned from, and the mean of edge lengths that noise makes longer.
    others = [
        Reconstruction.from_views(c.rig, pictures(boards(BOARDS, 100 + i), SIGMA, 100 + i))
        for i, (c, _) in enumerate(recordings)
    ]
    assert np.mean([r.scale.mean() for r in others]) == pytest.approx(1.0, abs=5e-4)
    assert np.mean([r.edges.mean() / r.square for r in others]) > 1.0 + 5e-4


def test_the_covariance_of_the_whole_rig_is_that_of_its_errors(recordings):
    """Not only of each parameter by itself: those of a lens hang together closely."""
    nees = []
    for result, _ in recordings:
        error = (result.rig.values - RIG.values)[np.isin(RIG.names, result.names)]
        nees.append(error @ np.linalg.solve(result.uncertainty.covariance, error))
    # Chi squared of 20: the mean over 20 recordings is known to 1.4.
    assert np.mean(nees) == pytest.approx(20.0, abs=4.5)
