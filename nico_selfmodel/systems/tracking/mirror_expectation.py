"""A tracker before a mirror that knows where its own hand should be seen."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, Multiplexer

from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.systems.tracking.hand_tracker import HandTracker
from nico_selfmodel.systems.tracking.self_model_predictor import SelfModelPredictor


def connect_expectation(
    builder: DiagramBuilder, encoders: OutputPort, tracker: HandTracker, model: SelfModel
) -> None:
    """Tell a tracker where a self-model expects each marker; nowhere where it does not know it.

    Args:
        builder: Of the diagram that the tracker is part of.
        encoders: Encoder readings, in the encoders' units.
        tracker: Made with `before_mirror`.
        model: What the body has learned of arm and cameras.

    Raises:
        ModelError: If the model has no arm or no cameras.
    """
    together = builder.AddNamedSystem("expectation", Multiplexer([4] * len(tracker.markers)))
    for k, marker in enumerate(tracker.markers):
        if marker in model.markers:
            predictor = SelfModelPredictor(model, marker)
            builder.AddNamedSystem(f"expectation_of_{marker}", predictor)
            builder.Connect(encoders, predictor.GetInputPort("encoders"))
            expected = predictor.GetOutputPort("pixels_predicted")
        else:
            nowhere = builder.AddSystem(ConstantVectorSource(np.full(4, np.nan)))
            expected = nowhere.get_output_port()
        builder.Connect(expected, together.get_input_port(k))
    builder.Connect(together.get_output_port(), tracker.GetInputPort("pixels_predicted"))
