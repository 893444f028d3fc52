"""A self-model as a URDF, with the learned shape of links where there is one."""
