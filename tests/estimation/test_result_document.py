"""What goes into `result.json`: complete, plain, and without a number that does not exist."""

import json
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.estimation.results.errors import ErrorStatistics
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters

SIGMA = 3e-4
KEYS = {
    "status",
    "reasons",
    "train",
    "test",
    "cross_validation",
    "parameters",
    "not_identifiable",
    "outliers",
    "seconds",
    "iterations",
    "converged",
}
STATISTICS = {"mean", "sd", "rms", "median", "p95", "max"}


@pytest.fixture(scope="module")
def truth(make_truth):
    return make_truth(3, 2, unit="counts", markers=2)


@pytest.fixture(scope="module")
def calibrations(truth, joined):
    """Return calibrations: good, unobservable, circles alone, and without redundancy."""
    circles = truth.dataset(*truth.sweeps(10), sigma=SIGMA, seed=1)
    train = joined(circles, truth.dataset(truth.poses(40, 1), sigma=SIGMA, seed=2, outliers=0.05))
    test = truth.dataset(truth.poses(30, 2), sigma=SIGMA, seed=3)
    few = truth.dataset(truth.poses(4, 5), sigma=SIGMA, seed=4)
    gauge = FixedParameters.from_text(free=["joint_2.alpha", "joint_0.D"])
    return {
        "good": calibrate_kinematics(train, test=test),
        "not evaluated": calibrate_kinematics(train, explain=False),
        "unobservable": calibrate_kinematics(train, test=test, pins=gauge, explain=False),
        "circles": calibrate_kinematics(circles, test=test, method="circle-points"),
        "exact": calibrate_kinematics(few, test=test, explain=False),
        "perfect": calibrate_kinematics(truth.dataset(*truth.sweeps(10)), test=test),
    }


@pytest.mark.parametrize(
    "kind", ["good", "not evaluated", "unobservable", "circles", "exact", "perfect"]
)
def test_every_document_is_plain_json_with_all_keys(calibrations, kind):
    calibration = calibrations[kind]
    document = to_json(calibration, judge(calibration))
    again = json.loads(json.dumps(document, allow_nan=False))
    assert again.keys() == document.keys()
    assert document.keys() >= KEYS
    assert document["status"] in ("PASS", "FAIL", "NOT_EVALUATED")
    assert document["reasons"]
    assert set(document["train"]["position_mm"]) == STATISTICS
    for part in ("test", "cross_validation"):
        if document[part] is not None:
            assert document[part]["n"] > 0
            assert set(document[part]["position_mm"]) == STATISTICS
    for name, entry in document["parameters"].items():
        assert set(entry) == {"value", "sigma", "unit", "free"}, name
        assert isinstance(entry["value"], float)


def test_numbers_are_those_of_the_calibration(calibrations, truth):
    good = calibrations["good"]
    document = to_json(good, judge(good))
    inliers = good.train.distances[~good.outliers]
    assert document["train"]["n"] == len(inliers)
    assert document["train"]["position_mm"]["rms"] == pytest.approx(
        1e3 * np.sqrt(np.mean(inliers**2))
    )
    assert document["test"]["n"] == 60
    assert document["cross_validation"]["n"] == len(good.cross_validation)
    assert document["noise_sigma_mm"] == pytest.approx(1e3 * good.model.noise_sigma)
    wrong = set(good.train.observations.sample[good.outliers].tolist())
    assert set(document["outliers"]) == wrong
    assert len(wrong) >= 2
    assert document["starts"]["agreeing"] >= 3
    assert len(document["circles"]) == 2 * 3
    assert {circle["joint"] for circle in document["circles"]} == set(truth.chain.joints)


def test_what_was_not_done_is_null(calibrations):
    circles, exact = calibrations["circles"], calibrations["exact"]
    document = to_json(circles, judge(circles))
    assert document["cross_validation"] is None
    assert document["starts"] is None
    assert document["parameters"]["joint_1.r"]["sigma"] is None
    assert to_json(exact, judge(exact))["cross_validation"] is None
    alone = calibrations["not evaluated"]
    assert to_json(alone, judge(alone))["test"] is None


def test_the_table_names_every_parameter_with_unit_and_freedom(calibrations):
    good = calibrations["good"]
    table = to_json(good, judge(good))["parameters"]
    names = good.model.parameters.names
    assert [n for n in table if n in names] == [n for n in names if n in table]
    assert set(names) - set(table) <= {n for n in names if n.endswith(".beta")}
    assert good.free <= set(table)
    for name, entry in table.items():
        assert entry["free"] is (name in good.free), name
        if name in good.free:
            assert entry["sigma"] > 0.0
    assert {n for n in names if n not in good.free and n in table} == {
        n for n in good.model.parameters.gauge if n in table
    }
    assert (table["joint_1.gear"]["unit"], table["M0.x"]["unit"]) == ("1", "m")
    assert table["noise_sigma"]["value"] == good.model.noise_sigma


def test_a_unobservable_parameter_has_no_sigma_and_others_have(calibrations):
    unobservable = calibrations["unobservable"]
    document = to_json(unobservable, judge(unobservable))
    assert document["status"] == "FAIL"
    assert len(document["not_identifiable"]) == 2
    assert document["parameters"]["joint_2.alpha"]["sigma"] is None
    assert document["parameters"]["joint_0.D"]["sigma"] is None
    assert document["parameters"]["joint_1.gear"]["sigma"] > 0.0


def test_statistics_are_those_of_distances():
    distances = np.array([3.0, 1.0, 2.0, 2.0, 7.0]) * 1e-3
    found = ErrorStatistics.from_distances(distances)
    assert (found.n, found.mean, found.median, found.max) == pytest.approx((5, 3e-3, 2e-3, 7e-3))
    assert found.rms**2 == pytest.approx(found.mean**2 + found.sd**2 * 4.0 / 5.0)
    assert found.as_mm()["p95"] == pytest.approx(1e3 * np.percentile(distances, 95))
    single = ErrorStatistics.from_distances(np.array([2e-3]))
    assert (single.sd, single.rms, single.p95) == pytest.approx((0.0, 2e-3, 2e-3))


@pytest.mark.slow
def test_the_model_remembers_where_it_came_from(calibrations, truth):
    model = calibrations["not evaluated"].model
    assert model.provenance["dataset"] == "truth"
    assert len(model.provenance["dataset_sha256"]) == 64
    assert "seed" not in model.provenance
    assert {"nico-selfmodel", "drake", "numpy"} <= set(model.provenance)
    assert model.fit["method"] == "refine"
    q = truth.dataset(*truth.sweeps(10))
    named = calibrate_kinematics(replace(q, name="other", seed=7), name="mine").model
    assert named.provenance["seed"] == 7
    assert (named.name, named.provenance["dataset"]) == ("mine", "other")
