"""Checks over days: their log, and an alarm with a stated false-alarm rate."""

from . import text as text  # registers the words of an alarm
