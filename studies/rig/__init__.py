"""Trials of rigs: consistency of the joint covariance, gain over separate fits."""
