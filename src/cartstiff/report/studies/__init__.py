"""Studies of designs, told and drawn."""
