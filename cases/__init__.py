"""Published numbers about stiffness, checked: ``python -m cases``."""
