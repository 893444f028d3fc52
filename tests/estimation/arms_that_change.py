"""Simulated arms under motion capture, their sessions, and what may happen to them in between."""

from dataclasses import replace
from functools import cache

import numpy as np

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS, Imperfections

THESIS, CLEAN = IMPERFECTIONS["thesis"], IMPERFECTIONS["clean"]
CELLS = {
    "clean": CLEAN,
    "thesis": THESIS,
    "joint noise": replace(CLEAN, name="joint noise", play=THESIS.play),
    "sag": replace(CLEAN, name="sag", sag=THESIS.sag),
    "wobble": replace(CLEAN, name="wobble", wobble=THESIS.wobble, wobble_share=THESIS.wobble_share),
    "tracker noise": replace(
        CLEAN,
        name="tracker noise",
        marker_sigma=THESIS.marker_sigma,
        dropout_share=THESIS.dropout_share,
    ),
}
"""The worlds, and each imperfection alone."""


@cache
def arm() -> ArmDescription:
    return ArmDescription.named("nico", "right_arm")


def session(
    world: Imperfections,
    seed: int,
    number: int,
    count: int = 100,
    *,
    sweeps: bool = False,
    tags: int = 1,
) -> Dataset:
    """Return random poses of one robot; the tags lie within centimetres of its hand's marker."""
    chain = arm().chain
    if tags > 1:
        off = np.random.default_rng(tags).normal(0.0, 0.02, (tags, 3))
        names = tuple(f"tag{k}" for k in range(tags))
        chain = replace(chain, markers=names, p_WH_zero=chain.p_WH_zero + off)
    protocol = replace(SweepProtocol.for_arm(arm()), random_poses=count)
    tagged = replace(arm(), chain=chain)
    return simulated_session(
        tagged, world, protocol, "session", seed=seed, session=number, sweeps=sweeps
    )


@cache
def learned_arm(world: Imperfections, seed: int, tags: int = 1) -> SelfModel:
    """Return what one robot learned from its circles and 100 random poses."""
    train = session(world, seed, 0, sweeps=True, tags=tags)
    return calibrate_kinematics(train, explain=False).model


def jumped(data: Dataset, model: SelfModel, joint: int, degrees: float, at: int = 0) -> Dataset:
    """Return data whose encoder of a joint jumped before a row, by so much of the joint's angle."""
    servos, encoders = model.servos, data.encoders.copy()
    moved = np.radians(degrees) * servos.gear[joint] / servos.radians_per_unit[joint]
    encoders[at:, joint] += moved
    return replace(data, encoders=encoders)
