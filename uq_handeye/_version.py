"""The version, so that nothing below imports the root of the package."""

__version__ = "0.5.0"
