"""The theory, one file per estimator: circle points, kinematics, stereo, body, tool; verdicts."""
