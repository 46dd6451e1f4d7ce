"""Rigs on the command line: several cameras, targets and arms, and what is done with their result."""
