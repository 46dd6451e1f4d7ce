"""Support of long computations: work arrays, progress, versions of what ran, executors."""
