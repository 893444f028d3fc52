"""Random arms, sound and faulty: what a verdict claims holds, and what would harm does not pass."""

import re
from dataclasses import dataclass

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge

from .random_arms import BENT, FAULTS, OUTLIERS, SOUND, Recording, random_recording

pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class Judged:
    """A verdict, and what is true of the arm that it speaks of."""

    status: str
    words: tuple[str, ...]
    claim: float
    """Mean error that the verdict prints first [m]; nan where it prints none."""
    error: float
    """Mean error on fresh poses in the trained range [m]."""
    spread: float
    """Standard error of the two."""

    @property
    def wrong(self) -> bool:
        above = self.error - self.claim
        return self.status == "PASS" and above > max(0.5 * self.claim, 3.0 * self.spread)


def judged(recording: Recording, data: Dataset) -> Judged:
    train, test = data.split(0.3, 1)
    try:
        calibration = calibrate_kinematics(train, test=test)
    except SelfModelError as refused:
        return Judged("REFUSED", (str(refused),), np.nan, np.nan, np.nan)
    verdict = judge(calibration)
    predicted = calibration.model.predict(recording.readings, "m0").p_WH
    errors = np.linalg.norm(predicted - recording.p_WH, axis=1)
    said = re.match(r"([\d.e+-]+) mm mean error", verdict.reasons[0])
    claim = float(said[1]) / 1e3 if said else np.nan
    held_out = test.select(test.measured).pose
    spread = errors.std() / np.sqrt(min(len(np.unique(held_out)), len(errors)))
    return Judged(verdict.status, verdict.reasons, claim, errors.mean(), spread)


@pytest.mark.parametrize("kind", SOUND)
def test_what_is_sound_passes_with_its_error(kind):
    for seed in range(9000, 9008):
        recording = random_recording(kind, seed)
        found = judged(recording, recording.dataset)
        assert found.status == "PASS", (kind, seed, found)
        assert not found.wrong, (kind, seed, found)


@pytest.mark.parametrize("kind", [*BENT, *OUTLIERS])
def test_what_passes_is_as_good_as_it_says(kind):
    for seed in range(9000, 9006):
        recording = random_recording(kind, seed)
        found = judged(recording, recording.dataset)
        assert not found.wrong, (kind, seed, found)


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_that_doubles_the_error_does_not_pass(kind):
    refused = 0
    for seed in range(9000, 9008):
        recording = random_recording(kind, seed)
        found = judged(recording, recording.dataset)
        assert not found.wrong, (kind, seed, found)
        refused += found.status != "PASS"
        if found.status == "PASS":
            sound = judged(recording, recording.sound)
            assert found.error <= 2.0 * sound.error, (kind, seed, found, sound)
    # Repeated poses harm nobody who counts them once.
    assert refused or kind == "repeats", kind


@pytest.mark.parametrize(("kind", "most"), [("clean", 1.1), ("joint noise", 1.15)])
def test_sigmas_of_predictions_are_those_of_their_errors(kind, most):
    """The mean NEES of 80 arms has a standard error of 0.05."""
    found = []
    for seed in range(7000, 7160):
        recording = random_recording(kind, seed, fresh=100)
        if kind == "joint noise" and len(recording.arm.hands) > 1:
            continue
        model = calibrate_kinematics(recording.dataset, explain=False).model
        predicted = model.predict(recording.readings, "m0")
        assert predicted.covariance is not None
        errors = predicted.p_WH - recording.p_WH_exact
        scaled = np.linalg.solve(predicted.covariance, errors[:, :, None])[:, :, 0]
        found.append(np.mean(np.sum(errors * scaled, axis=1)) / 3.0)
        if len(found) == 80:
            break
    assert 0.87 < np.mean(found) < most, np.round(found, 2)
