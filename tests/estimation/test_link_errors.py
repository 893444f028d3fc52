"""What joint noise leaves of errors in images, as the training told it."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.tree.link_errors import held_out_links, mean_length
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.sessions.whole_body import whole_body_session, whole_nico
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from .whole_body_truth import hand_errors


def test_the_mean_length_is_that_of_many_draws():
    rng = np.random.default_rng(0)
    S = np.array([[[4.0, 1.0], [1.0, 1.0]], [[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 0.0]]])
    drawn = [np.linalg.norm(rng.multivariate_normal([0, 0], s, 200_000), axis=1).mean() for s in S]
    assert mean_length(S) == pytest.approx(drawn, rel=0.01)
    assert mean_length(S)[1] == pytest.approx(np.sqrt(np.pi / 2.0))


@pytest.mark.slow
def test_the_noise_that_is_learned_tells_what_the_mechanics_leave():
    world = IMPERFECTIONS["thesis"]
    train = whole_body_session(world, 2, 0, looks=60, hands=80)
    test = whole_body_session(world, 2, 1, looks=5, hands=60)
    found = calibrate_tree(train, test=test, effects=())
    assert not held_out_links(replace(found, test=None))
    left = held_out_links(found)
    nico, _ = whole_nico(world, 2)
    for side in ("right", "left"):
        errors = left[f"{side}_wrist"]
        learned, true = hand_errors(found, nico, test, side)
        assert errors.mean_px == pytest.approx(learned, rel=0.01)
        assert errors.noise_px == pytest.approx(true, rel=0.15)
