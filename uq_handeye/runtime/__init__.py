"""What a long computation needs: work arrays, progress, versions of what ran, executors."""
