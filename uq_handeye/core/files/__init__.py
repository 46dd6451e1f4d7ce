"""Reading of untrusted files, and writing of files as a whole."""
