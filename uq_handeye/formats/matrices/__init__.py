"""Matrices as text and as the tools of robots and 3-D cameras write them."""
