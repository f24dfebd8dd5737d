"""Potential energies of a mechanism: joint springs, line springs, gravity,
users' functions.
"""
