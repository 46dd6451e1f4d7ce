"""Shared by the studies: command line and folder of results, geometries, noises, scores, the tables of the paper."""
