"""Planning of the poses to add next."""
