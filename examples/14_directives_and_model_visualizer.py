"""Name a learned arm in Drake's model directives, and look at it in Drake's ModelVisualizer.

nico-selfmodel learn --sensor motion-capture --out first_arm
python examples/14_directives_and_model_visualizer.py first_arm
"""

import argparse
import tempfile
from pathlib import Path

from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.visualization import ModelVisualizer

from nico_selfmodel.plant import add_directives

TABLE = """<robot name="table"><link name="top">
  <visual><origin xyz="0 0 -0.02"/><geometry><box size="1 1 0.04"/></geometry></visual>
</link></robot>"""
DIRECTIVES = """
directives:
- add_model: {{name: table, file: table.urdf}}
- add_weld: {{parent: world, child: table::top}}
- add_self_model:
    name: learned
    model: {model}
    frame: table::top
"""


def show(model, once):
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "table.urdf").write_text(TABLE)
        file = Path(folder) / "scene.dmd.yaml"
        file.write_text(DIRECTIVES.format(model=Path(model).resolve()))
        meshcat = Meshcat(MeshcatParams(host="localhost"))
        visualizer = ModelVisualizer(meshcat=meshcat, visualize_frames=True, triad_length=0.05)
        robots = add_directives(file, visualizer.parser())
    visualizer.Finalize()
    for name, robot in robots.items():
        print(f"{name}: {', '.join(robot.arm.joints)}, at {meshcat.web_url()}")
    visualizer.Run(loop_once=once)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", help="a result folder, or a self_model.yaml")
    parser.add_argument("--once", action="store_true", help="draw once, and end")
    arguments = parser.parse_args()
    show(arguments.model, arguments.once)
