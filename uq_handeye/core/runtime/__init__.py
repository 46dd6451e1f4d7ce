"""Support of long computations: work arrays, progress, threads, executors, and read-only results."""
