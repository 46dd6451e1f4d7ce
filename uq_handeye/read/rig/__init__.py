"""Rigs from files: the TOML file, or a robot file and a file for each camera."""
