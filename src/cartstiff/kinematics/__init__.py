"""Inverse kinematics: which coordinates reach a pose, for chains and platforms."""
