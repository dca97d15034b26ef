"""Radar presets, one TOML file each, with the source of every value."""
