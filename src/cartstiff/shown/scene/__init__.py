"""Stiffness drawn in any meshcat viewer."""
