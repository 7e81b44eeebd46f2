"""The models against theory and reference solutions: ``python -m validation``."""
