"""Common arms by name, many arms at once, and postures of poses without joint values."""
