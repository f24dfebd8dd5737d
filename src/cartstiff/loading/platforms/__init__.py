"""What mechanism files say of platforms."""
