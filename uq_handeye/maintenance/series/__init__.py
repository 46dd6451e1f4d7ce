"""Checks over days: their log, and an alarm with a stated false-alarm rate."""
