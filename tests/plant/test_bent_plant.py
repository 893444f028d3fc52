"""A self-model that bends under its own weight, in a plant and as a system."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.symbolic import Expression

from nico_selfmodel.model.arm.bending import PARTS, SAG, Bending
from nico_selfmodel.model.arm.uniform_rods import uniform_rods
from nico_selfmodel.model.self_model_file import load_model, save_model
from nico_selfmodel.plant import SelfModelPlant
from nico_selfmodel.plant.export.urdf_export import learned_urdf
from nico_selfmodel.systems import LoadedAngles

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def bent(arm, build_individual, learn):
    """Return a function: effects -> a self-model that has them, milliradians of each."""

    def make(*effects):
        model = learn(build_individual(arm.chain, seed=3, size=0.02))
        bending = Bending.none(model.joints, UP, *uniform_rods(model.dh)).with_effects(*effects)
        rng = np.random.default_rng(1)
        moved = bending.values + 5e-3 * rng.normal(size=len(bending.values))
        return replace(model, bending=bending.with_values(moved))

    return make


def readings_of(model, count=5):
    q = np.random.default_rng(2).uniform(-1.5, 1.5, (count, len(model.joints)))
    return model.servos.to_encoder(q)


@pytest.mark.parametrize("effects", [(SAG,), PARTS])
def test_a_plant_at_readings_is_where_the_model_predicts_it(arm, bent, effects):
    model = bent(*effects)
    robot = SelfModelPlant.from_urdf(arm, model)
    context, world = robot.plant.CreateDefaultContext(), robot.plant.world_frame()
    for reading in readings_of(model):
        robot.set_positions(context, reading)
        for k, marker in enumerate(model.markers):
            frame = robot.tracked_point_frame(marker)
            X_WH = robot.plant.CalcRelativeTransform(robot.own_context(context), world, frame)
            expected = model.predict(reading, np.array([k])).p_WH[0]
            np.testing.assert_allclose(X_WH.translation(), expected, rtol=0, atol=1e-12)
            q = model.servos.to_joint(reading)
            np.testing.assert_allclose(model.points(q, k), expected, rtol=0, atol=1e-12)
    rigid, whole = (
        m.predict(readings_of(model)).p_WH for m in (replace(model, bending=None), model)
    )
    assert np.linalg.norm(rigid - whole, axis=1).max() > 1e-5


def test_a_converted_plant_bends_likewise_and_its_derivatives_are_right(arm, bent):
    model = bent(*PARTS)
    robot = SelfModelPlant.from_urdf(arm, model)
    converted = robot.in_plant(robot.plant.ToAutoDiffXd())
    context = converted.plant.CreateDefaultContext()
    reading = readings_of(model)[0]
    converted.set_positions(context, InitializeAutoDiff(reading).ravel())
    p = converted.tracked_point_frame().CalcPoseInWorld(context).translation()
    unit = np.abs(1e-5 / model.servos.radians_per_unit)
    ends = [model.predict(reading + s * np.diag(unit)).p_WH for s in (1.0, -1.0)]
    slopes = ((ends[0] - ends[1]) / (2.0 * unit[:, None])).T
    size = np.abs(slopes).max()
    np.testing.assert_allclose(ExtractGradient(p) / size, slopes / size, atol=1e-7)


def test_loaded_angles_are_a_system_of_any_numbers(bent):
    model = bent(SAG, "ripple", "coupling")
    system, reading = LoadedAngles(model), readings_of(model)[0]
    expected = model.posture(model.servos.to_joint(reading)).q
    context = system.CreateDefaultContext()
    system.get_input_port().FixValue(context, reading)
    np.testing.assert_allclose(system.get_output_port().Eval(context), expected, rtol=1e-14)
    assert np.abs(expected - model.servos.to_joint(reading)).max() > 1e-4
    symbolic = system.ToSymbolic()
    context = symbolic.CreateDefaultContext()
    symbolic.get_input_port().FixValue(context, [Expression(x) for x in reading])
    found = [x.Evaluate() for x in symbolic.get_output_port().Eval(context)]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("effects", [(SAG,), PARTS])
def test_what_bends_is_read_back_to_the_last_bit(bent, tmp_path, effects):
    model = bent(*effects)
    save_model(model, tmp_path / "self_model.yaml")
    again = load_model(tmp_path / "self_model.yaml")
    assert again.bending.effects == model.bending.effects
    for name in ("up", "loads", "pivots", "sag", "bearing_sag", "ripple", "coupling"):
        assert np.array_equal(getattr(again.bending, name), getattr(model.bending, name)), name


def test_an_exported_description_says_that_it_is_rigid(arm, bent):
    assert "It is rigid: the geometry without its own weight" in learned_urdf(bent(SAG), arm)
