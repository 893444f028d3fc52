"""Nico holds up its hand before a mirror and finds the marker in its own reflection.

A station with a mirror has four ports more than one without: `mirror_pose`, through which the glass
can be put anywhere, and `reflected_pixels`, `reflected_seen` and `reflected_reasons`. A first guess
of the body, with the mirror where it was put, predicts the reflection to some ten pixels; `record
--mirror` and `calibrate mirror` learn the rest.
"""

import numpy as np

from nico_selfmodel import Mirror, MirrorRig, MirrorView, VisibleWorkspace, commands_of_angles
from nico_selfmodel.systems import (
    CameraMeasurement,
    MirrorPlate,
    NicoStation,
    StationBody,
    default_mirror_detectors,
    looking_arm,
    put_mirror,
)


def main() -> None:
    """Look into a mirror from three poses."""
    arm, plate = looking_arm("fiducial"), MirrorPlate(width=0.40, height=0.30)
    workspace = VisibleWorkspace.of(arm)
    mirror = Mirror.from_values([0.0, np.radians(-20.0), 0.3])
    view = MirrorView.of(workspace, mirror, plate, np.random.default_rng(0))
    detectors = {"fiducial": default_mirror_detectors()["fiducial"]}
    expected = MirrorRig(workspace.rig, mirror)
    errors = []
    with NicoStation("thesis", 5, arm=arm, detectors=detectors, mirror=plate) as station:
        body = StationBody(station, station.joints, arm.markers)
        put_mirror(station, body.context, view.X_BM)
        for q in view.q[:3]:
            (command,) = commands_of_angles(station.joints, arm.lower, arm.upper, [q])
            observation = body.move_and_measure(command)
            assert isinstance(observation, CameraMeasurement)
            seen = observation.reflected["fiducial"]
            guess = expected.project(arm.chain.forward(q))
            if np.isfinite(seen).all():
                errors.append(np.linalg.norm((seen - guess).reshape(2, 2), axis=1).mean())
                print(f"the reflection at {np.round(seen, 1)}, expected at {np.round(guess, 1)}")
            else:
                print(f"not seen: {', '.join(filter(None, observation.reflected_reasons))}")
    print(f"{len(errors)} of 3 seen, {np.mean(errors):.0f} px off on average")


if __name__ == "__main__":
    main()
