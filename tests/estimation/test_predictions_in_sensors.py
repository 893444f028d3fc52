"""Where a sensor sees the markers of a body, and how surely: errors that both share cancel."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.tree.body_prediction import predict_body
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.estimation.tree.tree_setup import Description
from nico_selfmodel.model.tree.body_model import BodyModel

from .simulated_trees import one_arm, turned

SEEDS = (3, 4, 5, 6)


def learned(seed):
    """Return a body that a tracker taught, a description 30 mm off its first guess; the truth."""
    made = one_arm(seed, joints=3, markers=2, poses=40, joint_sigma=1e-4)
    rng = np.random.default_rng(seed)
    X_PJ = np.stack([X @ turned(rng, 1.0, 30.0) for X in made.tree.X_PJ])
    nothing = {
        kind: tuple(replace(item, X_LA=np.eye(4)) for item in getattr(made.tree, kind))
        for kind in ("markers", "sensors")
    }
    description = Description(replace(made.tree, X_PJ=X_PJ, **nothing), shift_sigma=0.03)
    return body_model(calibrate_tree(made.data, description=description, effects=())), made


@pytest.fixture(scope="module")
def bodies():
    return [learned(seed) for seed in SEEDS]


def fresh(made, seed):
    """Return readings, and where the tracker would find the true markers there."""
    readings = np.random.default_rng(seed).uniform(-1.0, 1.0, (30, 3))
    true = predict_body(body_of(made), readings, frame="tracker")
    return readings, true.p_FM


def body_of(made):
    return BodyModel("true", made.tree, np.ones(len(made.tree.joints)))


@pytest.mark.slow
def test_places_in_the_tracker_are_as_exact_as_it_is(bodies):
    body, made = bodies[0]
    readings, true = fresh(made, 1)
    found, alone = predict_body(body, readings, frame="tracker"), predict_body(body, readings)
    assert np.linalg.norm(found.p_FM - true, axis=2).max() < 1e-3
    assert np.median(found.sigma) < 1e-3 < 5e-3 < np.median(alone.sigma)
    assert np.linalg.norm(alone.p_FM - true, axis=2).min() > 1e-3


@pytest.mark.slow
def test_sigmas_in_the_frame_of_a_sensor_cover_what_is_off(bodies):
    ratios = []
    for (body, made), seed in zip(bodies, SEEDS, strict=True):
        readings, true = fresh(made, seed)
        found = predict_body(body, readings, frame="tracker")
        off = np.sum((found.p_FM - true) ** 2, axis=2)
        # Joint noise is in the total, and not in these readings.
        ratios.append(np.sqrt(np.mean(off / (3.0 * found.sigma**2))))
        assert (found.total_sigma > found.sigma).all()
        quiet = predict_body(replace(body, noise={}), readings, frame="tracker")
        np.testing.assert_allclose(quiet.total_sigma, found.sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_pixels_do_not_depend_on_the_frame_that_places_are_told_in():
    made = one_arm(2, sensor="camera")
    readings = np.random.default_rng(0).uniform(-1.0, 1.0, (8, 5))
    world, left = (predict_body(body_of(made), readings, frame=one) for one in (None, "left"))
    assert (world.p_FM != left.p_FM).all()
    for camera in ("left", "right"):
        np.testing.assert_allclose(left.pixels[camera], world.pixels[camera])
    lens = made.tree.lenses["left"].at(np.eye(4))
    shown = lens.project(left.p_FM.reshape(-1, 3)).reshape(8, -1, 2)
    np.testing.assert_allclose(shown, left.pixels["left"], atol=1e-6)


def test_what_is_out_of_a_picture_has_no_pixels():
    model = body_of(one_arm(2, sensor="camera"))
    readings = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 5))
    pixels = predict_body(model, readings).pixels["left"]
    narrow = replace(model.tree.lenses["left"], image_size=(320, 480))
    tree = replace(model.tree, lenses={**model.tree.lenses, "left": narrow})
    cut = predict_body(replace(model, tree=tree), readings).pixels["left"]
    inside = pixels[..., 0] < 319.5
    assert inside.any()
    assert not inside.all()
    np.testing.assert_array_equal(cut[inside], pixels[inside])
    assert np.isnan(cut[~inside]).all()
    seen = pixels[np.isfinite(pixels).all(axis=-1)]
    assert ((seen > -0.5) & (seen < np.array([639.5, 479.5]))).all()


def test_a_frame_that_is_no_sensor_is_refused_by_name():
    made = one_arm(2, joints=2)
    with pytest.raises(ValueError, match="no sensor 'tracer', did you mean 'tracker'"):
        predict_body(body_of(made), np.zeros((1, 2)), frame="tracer")
