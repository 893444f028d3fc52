"""The report: one page, made of sections that each kind of evidence offers."""

from nico_selfmodel.viz.figures.quick_artists import load_quickly

load_quickly()
