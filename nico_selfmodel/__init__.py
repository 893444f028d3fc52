"""A robot that learns its own body by watching it move.

The rooms of the package are imported by name (`from nico_selfmodel.model import SelfModel`); this
file imports none of them, so that `import nico_selfmodel` costs nothing.
"""

__version__ = "0.1.0"
