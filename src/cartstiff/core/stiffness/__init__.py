"""The one reduction from joint space to the end-effector, and its result."""
