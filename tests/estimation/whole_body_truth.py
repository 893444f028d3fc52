"""What is true of a simulated whole Nico, against what a calibration says of it."""

import numpy as np

from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.systems.looking import HEAD_JOINTS


def axes_in_the_room(motion, joints):
    """Directions and points of axes at the first pose. Shapes (k, 3)."""
    return motion.R_WJ[joints, :, 2, 0], motion.p_WJ[joints, :, 0]


def true_motion(nico, encoders):
    """Where a body that knew itself exactly would expect everything: what sags, but no play."""
    mechanics = nico.mechanics
    q = np.vstack([mechanics.posture(row) for row in mechanics.expected_angles(encoders)])
    return TreeMotion.at(mechanics.tree, q)


def axis_deviations(found, nico):
    """Deviations of the head's axes from the truth in their sigmas, at the middle of the training.

    Two parts of each direction, two of each place across the axis. Shape (joints, 4).
    """
    names = list(found.tree.joints)
    joints = [names.index(name) for name in HEAD_JOINTS]
    middle = np.median(found.data.readings, axis=0)[None]
    factor = np.array([joint.si_per_unit for joint in found.data.joints])
    z_true, p_true = axes_in_the_room(true_motion(nico, middle), joints)
    basis = tangent_basis(z_true)

    def told(values):
        tree = found.parameters.tree_of(values)
        z, p = axes_in_the_room(TreeMotion.at(tree, middle * factor), joints)
        along = np.sum((p_true - p) * z, axis=1, keepdims=True)
        off = np.stack([z - z_true, p + along * z - p_true], axis=1)
        return np.einsum("kim,kmj->kij", off, basis).ravel()

    values, names = found.values, found.uncertainty.names
    slopes = []
    for name in names:
        step = np.zeros(len(values))
        step[found.parameters.index[name]] = 1e-6
        slopes.append((told(values + step) - told(values - step)) / 2e-6)
    J = np.array(slopes)
    sigma = np.sqrt(np.einsum("pi,pq,qi->i", J, found.uncertainty.covariance, J))
    return (told(values) / sigma).reshape(len(joints), 4)


def pixel_errors(tree, motion, data, markers):
    """Distances of seen markers from where a body expects them [px], nan where not expected."""
    table, out = data.observations, []
    rows = np.isin(table.marker, [tree.marker_index(name) for name in markers])
    p_WM = motion.points(table.marker[rows], table.pose[rows])
    for s, sensor in enumerate(tree.sensors):
        own = table.sensor[rows] == s
        R, p = motion.pose_of(sensor)
        pose = table.pose[rows][own]
        X_CW = inverse(transform(R.transpose(2, 0, 1), p.T))[pose]
        p_CM = np.einsum("nij,nj->ni", X_CW[:, :3, :3], p_WM[own]) + X_CW[:, :3, 3]
        seen = table.values[rows][own][:, :2]
        expected = tree.lenses[sensor.name].at(np.eye(4)).project(p_CM)
        out.append(np.linalg.norm(expected - seen, axis=1))
    return np.concatenate(out)


def hand_errors(found, nico, test, side):
    """Mean held-out errors of one hand in the images: learned, and what mechanics leave [px]."""
    markers = [m.name for m in found.tree.markers if m.name.startswith(f"{side}_")]
    learned = TreeMotion.at(found.tree, test.si_readings, approach=test.si_approach)
    true = true_motion(nico, test.readings)
    return (
        float(np.nanmean(pixel_errors(found.tree, learned, test, markers))),
        float(np.nanmean(pixel_errors(nico.mechanics.tree, true, test, markers))),
    )
