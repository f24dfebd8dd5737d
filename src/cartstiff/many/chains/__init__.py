"""Chains of joints, open and closed: their numbers, recorded."""
