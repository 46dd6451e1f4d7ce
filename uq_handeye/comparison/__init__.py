"""All methods on the same data."""
