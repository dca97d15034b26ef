"""Checks that other software can be put through."""
