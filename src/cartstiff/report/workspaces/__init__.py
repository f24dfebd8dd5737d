"""Workspaces in words and pictures."""
