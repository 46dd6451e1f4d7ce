"""Poses written as matrices, and as 3-D camera software and Franka robots write them."""
