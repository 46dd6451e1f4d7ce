"""Which poses to add next."""
