"""Noise models: covariances of poses and motions, also shared between poses, and their square roots."""
