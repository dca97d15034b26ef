"""Trained models in forms for other programs."""
