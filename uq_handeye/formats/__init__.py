"""One pose-file format per file, and the detection of which it is."""
