"""The stiffest postures along a tool's path, and where the workpiece should lie."""
