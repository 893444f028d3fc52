"""Scenes, figures and the report; nothing below knows that pictures exist."""

from nico_selfmodel.viz.camera_report import camera_report_html
from nico_selfmodel.viz.camera_scene import camera_scene
from nico_selfmodel.viz.drake_backend import draw_in_drake, static_html
from nico_selfmodel.viz.experiment_charts import BarSeries, Level, bar_chart, save_figure
from nico_selfmodel.viz.kinematics_scene import calibration_scene
from nico_selfmodel.viz.meshcat_backend import publish
from nico_selfmodel.viz.report import report_html
from nico_selfmodel.viz.result_folder import load_scene, write_camera_folder, write_result_folder
from nico_selfmodel.viz.scene import Scene

__all__ = [
    "BarSeries",
    "Level",
    "Scene",
    "bar_chart",
    "calibration_scene",
    "camera_report_html",
    "camera_scene",
    "draw_in_drake",
    "load_scene",
    "publish",
    "report_html",
    "save_figure",
    "static_html",
    "write_camera_folder",
    "write_result_folder",
]
