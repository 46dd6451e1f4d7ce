"""Simulated rigs and fast repeated trials."""
