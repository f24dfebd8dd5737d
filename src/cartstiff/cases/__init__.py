"""Published numbers about stiffness, checked: ``python -m cartstiff.cases``."""
