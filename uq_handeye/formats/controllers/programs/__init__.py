"""Poses that stand in the programs and data files of controllers, one module per maker."""
