"""Corner files, camera folders and intrinsics on disk."""
