"""Camera parameters held, freed and known beforehand: by name, and with the right weight."""

import numpy as np
import pytest

from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions, by_full_name
from nico_selfmodel.model.cameras.rig_parameters import rig_names
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

from .simulated_boards import RIG, TRUTH, boards, changed, pictures

NAMES = rig_names()
ALONE = rig_names(("left",))


@pytest.fixture(scope="module")
def views():
    return pictures(boards(10), 0.2)


@pytest.fixture(scope="module")
def plain(views):
    return calibrate_cameras(views)


def learn(views, **options):
    found = calibrate_cameras(views, CameraOptions(**options))
    values = dict(zip(RIG.names, found.rig.values, strict=True))
    return values, dict(zip(found.names, found.uncertainty.sigma, strict=True)), found


def test_skew_and_tangential_distortion_are_held_at_zero_unless_asked_for():
    held = CameraOptions().held(NAMES)
    assert held == dict.fromkeys(
        [f"{e}.{n}" for e in ("left", "right") for n in ("skew", "p1", "p2")], 0.0
    )
    assert set(CameraOptions(tangential=True).held(NAMES)) == {"left.skew", "right.skew"}
    assert CameraOptions(freed=frozenset(["p2", "left.skew"])).held(NAMES) == {
        "left.p1": 0.0,
        "right.p1": 0.0,
        "right.skew": 0.0,
    }


def test_a_name_without_a_camera_means_every_camera():
    assert by_full_name({"k3": 1}, NAMES) == {"left.k3": 1, "right.k3": 1}
    assert by_full_name({"right.k3": 1}, NAMES) == {"right.k3": 1}
    assert by_full_name({"k3": 1, "right.k3": 2}, NAMES) == {"left.k3": 1, "right.k3": 2}
    assert by_full_name({"pose.x": 1}, NAMES) == {"right.pose.x": 1}
    assert by_full_name({"k3": 1}, ALONE) == {"left.k3": 1}


@pytest.mark.parametrize(
    ("word", "answer"),
    [
        (
            "skeww",
            r"parameter 'skeww', did you mean 'skew'\? There are skew, left.skew, right.skew",
        ),
        ("left.cz", r"no camera parameter 'left.cz', did you mean 'left.c[xy]'\?"),
        ("quark", r"no camera parameter 'quark'; there are left.fx"),
        ("right.pose", r"'right.pose', did you mean 'right.pose.\w+'\?"),
    ],
)
@pytest.mark.parametrize("how", ["pinned", "freed", "priors"])
def test_an_unknown_name_is_answered_with_the_one_that_was_meant(views, word, answer, how):
    value = {"pinned": {word: None}, "freed": frozenset([word]), "priors": {word: (0.0, 1.0)}}
    with pytest.raises(ValueError, match=answer):
        calibrate_cameras(views, CameraOptions(**{how: value[how]}))


def test_the_other_camera_has_no_name_where_only_one_is_calibrated(views):
    with pytest.raises(ValueError, match=r"no camera parameter 'right.fx'"):
        calibrate_cameras(views.only("left"), CameraOptions(pinned={"right.fx": 380.0}))
    with pytest.raises(ValueError, match=r"no camera parameter 'right.pose.x'"):
        calibrate_cameras(views.only("left"), CameraOptions(priors={"right.pose.x": (0.07, 1.0)}))


def test_what_concerns_one_camera_leaves_out_the_other_and_the_pose():
    options = CameraOptions(
        pinned={"k3": 0.0, "right.cx": None, "left.cy": 1.0, "right.pose.x": 0.07},
        freed=frozenset(["skew", "right.p1"]),
        priors={"fx": (380.0, 1.0), "right.fy": (380.0, 1.0)},
    )
    left = options.of_camera("left")
    assert left.pinned == {"k3": 0.0, "left.cy": 1.0}
    assert left.freed == {"skew"}
    assert left.priors == {"fx": (380.0, 1.0)}


def test_a_pinned_parameter_keeps_its_value_and_the_others_make_the_best_of_it(views, plain):
    value, sigma, found = learn(views, pinned={"left.fx": 385.0, "right.pose.x": 0.07})
    assert (value["left.fx"], value["right.pose.x"]) == (385.0, 0.07)
    assert {"left.fx", "right.pose.x"}.isdisjoint(found.names)
    assert set(plain.names) - set(found.names) == {"left.fx", "right.pose.x"}
    assert found.converged
    assert found.cost > plain.cost
    assert value["left.fy"] > TRUTH["left.fy"] + sigma["left.fy"]  # square pixels stay square


def test_a_pin_without_a_value_holds_the_nominal_one(views):
    value, _, found = learn(views, pinned=dict.fromkeys(["cx", "right.cy", "k3", "skew", "p1"]))
    assert (value["left.cx"], value["right.cx"], value["right.cy"]) == (319.5, 319.5, 239.5)
    assert value["left.k3"] == value["right.k3"] == value["left.skew"] == value["right.p1"] == 0.0
    assert "left.cy" in found.names
    assert not {"left.cx", "right.cx", "right.cy", "left.k3", "right.k3"} & set(found.names)


@pytest.mark.parametrize("name", ["fx", "right.fy", "right.pose.x"])
def test_what_has_no_nominal_value_cannot_be_held_at_it(views, name):
    with pytest.raises(ValueError, match=name):
        calibrate_cameras(views, CameraOptions(pinned={name: None}))


def test_a_pin_at_the_truth_makes_the_rest_surer(views, plain):
    value, sigma, _ = learn(views, pinned={n: TRUTH[n] for n in ("left.cx", "left.cy", "left.k3")})
    before = dict(zip(plain.names, plain.uncertainty.sigma, strict=True))
    assert all(sigma[n] <= 1.02 * before[n] for n in sigma)
    assert sigma["left.k2"] < 0.6 * before["left.k2"]
    assert abs(value["left.k2"] - TRUTH["left.k2"]) < 4.0 * sigma["left.k2"]


def test_a_freed_parameter_is_estimated(views):
    _, sigma, found = learn(views, freed=frozenset(["left.skew"]), tangential=True)
    assert {"left.skew", "left.p1", "right.p2"} < set(found.names)
    assert "right.skew" not in sigma
    assert 0.0 < abs(found.cameras[0].skew) < 4.0 * sigma["left.skew"]


@pytest.mark.parametrize("aspect", [1.0, 383.0 / 381.0])
def test_a_held_aspect_leaves_one_focal_length(views, aspect):
    _, _, found = learn(views, aspect=aspect)
    assert [c.fy / c.fx for c in found.cameras] == pytest.approx([aspect] * 2, rel=1e-12)
    assert not any(name.endswith("fy") for name in found.names)
    assert "left.fx" in found.names
    assert found.converged


def test_a_held_aspect_that_is_true_is_exact():
    rig = StereoRig(RIG.left, RIG.left.at(RIG.right.X_WC))
    found = calibrate_cameras(
        pictures(boards(8, 1, rig=rig), rig=rig), CameraOptions(aspect=383.0 / 381.0)
    )
    assert found.rig.values == pytest.approx(rig.values, rel=1e-6, abs=1e-7)


def test_a_tight_prior_decides_and_a_loose_one_does_not(views, plain):
    tight, sigma, _ = learn(views, priors={"left.fx": (385.0, 1e-4)})
    assert tight["left.fx"] == pytest.approx(385.0, abs=1e-3)
    assert sigma["left.fx"] < 2e-4
    *_, found = learn(views, priors={"fx": (500.0, 1e4)})
    before = plain.uncertainty.sigma
    off = np.abs(found.rig.values - plain.rig.values)[np.isin(NAMES, plain.names)]
    assert (off < 1e-3 * before).all()
    assert found.uncertainty.sigma == pytest.approx(before, rel=1e-3)


@pytest.mark.parametrize("name", ["left.fx", "right.k2", "right.pose.z"])
def test_a_prior_as_sure_as_the_corners_meets_them_half_way(views, plain, name):
    column = plain.names.index(name)
    own, sigma = plain.rig.values[NAMES.index(name)], plain.uncertainty.sigma[column]
    value, with_prior, found = learn(views, priors={name: (own + 2.0 * sigma, sigma)})
    assert value[name] == pytest.approx(own + sigma, abs=0.05 * sigma)
    assert with_prior[name] == pytest.approx(sigma / np.sqrt(2.0), rel=0.03)
    # Whatever the prior weighs, figures in pixels stay figures in pixels.
    assert found.pixel_sigma == pytest.approx(0.2, rel=0.05)
    assert found.cost == pytest.approx(0.5 * np.sum(found.residuals**2))
    assert found.rms == pytest.approx(plain.rms, rel=0.01)


def test_a_prior_and_a_bad_board_do_not_get_in_each_others_way(views, plain):
    noise = np.random.default_rng(5).normal(0.0, 30.0, views.pixels[0].shape)
    _, _, found = learn(changed(views, 2, noise), priors={"left.fx": (381.0, 100.0)})
    assert np.flatnonzero(found.outliers).tolist() == [2]
    assert found.pixel_sigma == pytest.approx(0.2, rel=0.05)


def test_the_words_of_a_command_line_are_read():
    options = CameraOptions.from_text(
        pin=["cx", "left.k3=-0.01", " p1 = 2e-3"],
        free=["skew", "right.p2"],
        prior=["fx=535,2.5"],
        aspect=1.0,
        loss="huber",
    )
    assert options.pinned == {"cx": None, "left.k3": -0.01, "p1": 2e-3}
    assert options.freed == {"skew", "right.p2"}
    assert options.priors == {"fx": (535.0, 2.5)}
    assert (options.aspect, options.loss, options.tangential) == (1.0, "huber", False)
    assert CameraOptions.from_text() == CameraOptions()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"pin": ["cx=left"]}, "--fix cx=left: 'left' is not a number"),
        ({"pin": ["cx="]}, "--fix cx=: '' is not a number"),
        ({"pin": ["cx=nan"]}, "'nan' is not a finite number"),
        ({"prior": ["fx"]}, "--prior must be NAME=MEAN,SIGMA, got fx"),
        ({"prior": ["fx=3"]}, "--prior must be NAME=MEAN,SIGMA, got fx=3"),
        ({"prior": ["fx=3,wide"]}, "'wide' is not a number"),
        ({"prior": ["fx=3,0"]}, "--prior fx=3,0: sigma must be positive"),
        ({"prior": ["fx=3,-1"]}, "sigma must be positive"),
        ({"prior": ["fx=3,inf"]}, "'inf' is not a finite number"),
        ({"pin": ["k3", "skew"], "free": ["skew"]}, "skew: fixed and freed at once"),
    ],
)
def test_words_that_make_no_sense_are_refused(words, message):
    with pytest.raises(ValueError, match=message):
        CameraOptions.from_text(**words)
