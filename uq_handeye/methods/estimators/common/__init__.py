"""Parts that several published estimators share."""
