"""The predictor's ports, and the servo map's, say what the self-model says, in any scalars."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.symbolic import Expression, MakeVectorVariable
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.arm.bending import PARTS, Bending
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.arm.uniform_rods import uniform_rods
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.systems.tracking.self_model_predictor import SelfModelPredictor
from nico_selfmodel.systems.tracking.servo_maps import (
    AnglesToEncoders,
    EncodersToAngles,
    LoadedAngles,
)

ARM = ArmDescription.named("nico")
Q = np.radians([-50.0, 30.0, -20.0, -75.0])


PORTS = ("p_WH_predicted", "covariance", "pixels_predicted")


def model(cameras=True, known=True, below=0.3):
    n = len(ARM.joints)
    servos = ServoMap(
        ARM.joints, np.zeros(n), np.ones(n), ("rad",) * n, np.full(n, np.nan), np.ones(n)
    )
    covariance = ParameterCovariance(("right_elbow.theta_offset",), [[1e-4]]) if known else None
    X_WL = np.eye(4)
    X_WL[:3, 3] = ARM.chain.forward(Q) - [0.0, 0.0, below]
    camera = Camera(380.0, 380.0, 320.0, 240.0, (640, 480), k1=-0.2, X_WC=X_WL)
    pair = {"left": camera, "right": replace(camera, cx=310.0)} if cameras else {}
    table = DhTable.from_chain(ARM.chain)
    return SelfModel("arm", table, servos, covariance, cameras=pair)


def output(system, port, readings=Q):
    context = system.CreateDefaultContext()
    system.GetInputPort("encoders").FixValue(context, readings)
    return system.GetOutputPort(port).Eval(context)


def test_the_ports_agree_with_the_self_model():
    known = model()
    predictor = SelfModelPredictor(known)
    prediction = known.predict(Q)
    assert output(predictor, "p_WH_predicted") == pytest.approx(prediction.p_WH[0])
    covariance = output(predictor, "covariance").reshape(3, 3)
    assert covariance == pytest.approx(prediction.covariance[0])
    assert np.trace(covariance) > 0.0
    assert output(predictor, "pixels_predicted") == pytest.approx(
        known.rig.project(prediction.p_WH)[0]
    )
    assert output(predictor, "pixels_predicted")[0] == pytest.approx(320.0)


def bent(known):
    """Return the same arm, which bends by its own weight and whose gears ripple."""
    table = known.dh
    rigid = Bending.none(table.joints, [0.0, 0.6, 0.8], *uniform_rods(table))
    some = rigid.with_effects(*PARTS)
    values = 1e-2 * np.random.default_rng(3).standard_normal(len(some.values))
    return replace(known, bending=some.with_values(some.values + values))


def test_the_ports_of_an_arm_that_bends_agree_with_its_self_model():
    known = bent(model())
    predictor, prediction = SelfModelPredictor(known), known.predict(Q)
    assert np.linalg.norm(prediction.p_WH - model().predict(Q).p_WH) > 1e-3
    assert output(predictor, "p_WH_predicted") == pytest.approx(prediction.p_WH[0])
    pixels = known.rig.project(prediction.p_WH)[0]
    assert output(predictor, "pixels_predicted") == pytest.approx(pixels)


def test_one_posture_of_an_arm_that_bends_is_that_of_many():
    known = bent(model())
    many = known.points(np.stack([Q, 0.5 * Q]), [0, 0])
    for marker in (0, [0]):
        np.testing.assert_allclose(known.points(Q, marker), many[0])
    np.testing.assert_allclose(known.points(0.5 * Q), many[1])


def test_a_hand_behind_the_cameras_has_no_pixels():
    assert np.isfinite(output(SelfModelPredictor(model()), "pixels_predicted")).all()
    assert np.isnan(output(SelfModelPredictor(model(below=-0.1)), "pixels_predicted")).all()


def test_what_is_not_known_is_nan_and_what_is_not_there_has_no_port():
    assert np.isnan(output(SelfModelPredictor(model(known=False)), "covariance")).all()
    assert not SelfModelPredictor(model(cameras=False)).HasOutputPort("pixels_predicted")


@pytest.mark.parametrize("system", [EncodersToAngles, AnglesToEncoders, LoadedAngles])
def test_systems_of_joints_refuse_what_does_not_know_them(system):
    known = model()
    wrong = known.servos if system is LoadedAngles else known
    with pytest.raises(TypeError, match=f"is expected, got a {type(wrong).__name__}: give the"):
        system(wrong)
    with pytest.raises(TypeError, match="SelfModel is expected, got a ServoMap"):
        SelfModelPredictor(known.servos)


def test_a_model_without_an_arm_or_marker_is_refused():
    with pytest.raises(ModelError, match="no arm"):
        SelfModelPredictor(SelfModel("cameras"))
    with pytest.raises(ValueError, match="no marker"):
        SelfModelPredictor(model(), "nose")


def geared():
    """Return a self-model whose encoders are not its joints."""
    n = len(ARM.joints)
    servos = ServoMap(
        ARM.joints, np.linspace(-0.3, 0.2, n), np.linspace(0.9, 1.4, n), ("counts",) * n,
        np.full(n, 4096.0), np.array([1.0, -1.0, 1.0, 1.0]),
    )  # fmt: skip
    known = ParameterCovariance(("right_elbow.gear", "right_shoulder_roll.r"), [[4, 1], [1, 2]])
    return replace(model(), servo_map=servos, covariance=known)


@pytest.mark.parametrize("bends", [False, True])
@pytest.mark.parametrize("port", PORTS)
def test_derivatives_of_the_converted_predictor_are_central_differences(port, bends):
    known = bent(geared()) if bends else geared()
    readings, h = known.servos.to_encoder(Q), 1e-3
    predictor = SelfModelPredictor(known)
    seen = output(predictor.ToAutoDiffXd(), port, InitializeAutoDiff(readings).ravel())
    np.testing.assert_allclose(ExtractValue(seen).ravel(), output(predictor, port, readings))
    differences = [
        output(predictor, port, readings + step) - output(predictor, port, readings - step)
        for step in h * np.eye(len(readings))
    ]
    expected = np.array(differences).T / (2.0 * h)
    assert np.abs(expected).max() > 0.0
    np.testing.assert_allclose(ExtractGradient(seen), expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("bends", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("port", PORTS)
def test_expressions_of_the_converted_predictor_have_its_values(port, bends):
    known = bent(geared()) if bends else geared()
    readings = known.servos.to_encoder(Q)
    variables = MakeVectorVariable(len(readings), "e")
    symbols = np.array([Expression(variable) for variable in variables])
    found = output(SelfModelPredictor(known).ToSymbolic(), port, symbols)
    values = [x.Evaluate(dict(zip(variables, readings, strict=True))) for x in found]
    np.testing.assert_allclose(values, output(SelfModelPredictor(known), port, readings))


def test_what_is_not_seen_or_not_known_is_nan_in_a_converted_predictor_too():
    q = InitializeAutoDiff(Q).ravel()
    hidden = SelfModelPredictor(model(below=-0.1)).ToAutoDiffXd()
    unknown = SelfModelPredictor(model(known=False)).ToAutoDiffXd()
    assert np.isnan(ExtractValue(output(hidden, "pixels_predicted", q))).all()
    assert np.isnan(ExtractValue(output(unknown, "covariance", q))).all()


@pytest.mark.parametrize("off", [40.0, 89.9, 91.0, 120.0])
def test_a_fisheye_shows_the_hand_past_90_degrees_in_any_scalars(off):
    known = model()
    p, way = ARM.chain.forward(Q), np.radians(off)
    X_WC = np.eye(4)
    X_WC[:3, 3] = p - 0.5 * np.array([np.sin(way), 0.0, np.cos(way)])
    wide = Camera(150.0, 150.0, 320.0, 240.0, (640, 480), k1=-0.02, lens="fisheye", X_WC=X_WC)
    predictor = SelfModelPredictor(replace(known, cameras={"left": wide, "right": wide}))
    pixels = output(predictor, "pixels_predicted")
    assert pixels[0] == pytest.approx(320.0 + 150.0 * way * (1.0 - 0.02 * way**2))
    found = output(predictor.ToAutoDiffXd(), "pixels_predicted", InitializeAutoDiff(Q).ravel())
    assert ExtractValue(found).ravel() == pytest.approx(pixels)
    step = 1e-6 * np.eye(len(Q))
    moved = [[output(predictor, "pixels_predicted", Q + s * d) for d in step] for s in (1, -1)]
    slopes = (np.array(moved[0]) - moved[1]).T / 2e-6
    assert ExtractGradient(found) == pytest.approx(slopes, abs=1e-4)
    told = output(predictor.ToSymbolic(), "pixels_predicted", [Expression(x) for x in Q])
    assert [one.Evaluate() for one in told] == pytest.approx(pixels)


@pytest.mark.parametrize("k", [{}, {"k1": -0.2, "k2": 0.05, "k3": 0.01}])
@pytest.mark.parametrize("edge", [-1.0, 1.0])
def test_a_hand_that_is_not_in_the_image_has_no_pixels(k, edge):
    known, p = model(), ARM.chain.forward(Q)
    cameras = {}
    for side, off in (("left", 319.9), ("right", 320.6)):
        X_WC = np.eye(4)
        X_WC[:3, 3] = p - [edge * off / 300.0, 0.0, 1.0]
        cameras[side] = Camera(300.0, 300.0, 319.5, 239.5, (640, 480), X_WC=X_WC)
    X_WC = np.eye(4)
    X_WC[:3, 3] = p - [3.0, 0.0, 0.3]
    predictor = SelfModelPredictor(replace(known, cameras=cameras))
    for system, readings in (
        (predictor, Q),
        (predictor.ToAutoDiffXd(), InitializeAutoDiff(Q).ravel()),
    ):
        pixels = output(system, "pixels_predicted", readings)
        pixels = pixels if pixels.dtype == float else ExtractValue(pixels).ravel()
        assert pixels[0] == pytest.approx(319.5 + edge * 319.9)
        assert np.isnan(pixels).tolist() == [False, False, True, True]
    aside = Camera(300.0, 300.0, 320.0, 240.0, (640, 480), X_WC=X_WC, **k)
    predictor = SelfModelPredictor(replace(known, cameras={"left": aside, "right": aside}))
    assert np.isnan(output(predictor, "pixels_predicted")).all()


def test_a_diagram_from_angles_through_encoders_to_the_hand_converts():
    known = geared()
    builder = DiagramBuilder()
    there = builder.AddSystem(AnglesToEncoders(known.servos))
    back = builder.AddSystem(EncodersToAngles(known.servos))
    predictor = builder.AddSystem(SelfModelPredictor(known))
    for port in (back.get_input_port(), predictor.get_input_port()):
        builder.Connect(there.GetOutputPort("encoders_commanded"), port)
    builder.ExportInput(there.GetInputPort("q_commanded"), "q")
    builder.ExportOutput(back.GetOutputPort("q_measured"), "q_measured")
    builder.ExportOutput(predictor.GetOutputPort("p_WH_predicted"), "p")
    diagram = builder.Build()
    for converted, q in ((diagram, Q), (diagram.ToAutoDiffXd(), InitializeAutoDiff(Q).ravel())):
        context = converted.CreateDefaultContext()
        converted.get_input_port().FixValue(context, q)
        hand = converted.GetOutputPort("p").Eval(context)
        same = converted.GetOutputPort("q_measured").Eval(context)
        if q is not Q:
            same, hand = ExtractValue(same).ravel(), ExtractValue(hand).ravel()
        np.testing.assert_allclose(same, Q, atol=1e-12)
        np.testing.assert_allclose(hand, known.chain.forward(Q), atol=1e-12)


def test_joints_that_are_not_commanded_stay_at_nan():
    servos = geared().servos
    system = AnglesToEncoders(servos)
    context = system.CreateDefaultContext()
    system.get_input_port().FixValue(context, [0.1, np.nan, 0.2, np.nan])
    readings = system.get_output_port().Eval(context)
    assert np.isnan(readings).tolist() == [False, True, False, True]
    assert readings[0] == servos.to_encoder([0.1, 0.0, 0.0, 0.0])[0]
