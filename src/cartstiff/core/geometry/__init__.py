"""Rigid motions, twists and wrenches, affine connections, charts."""
