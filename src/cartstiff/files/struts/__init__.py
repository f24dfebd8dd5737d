"""Legs with joints that bend, which platforms of files have."""
