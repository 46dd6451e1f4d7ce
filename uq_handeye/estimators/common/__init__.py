"""What several published estimators share."""
