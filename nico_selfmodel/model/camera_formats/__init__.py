"""Cameras in the files of other programs: OpenCV, ROS, Kalibr, mrcal."""
