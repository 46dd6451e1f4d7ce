"""Read untrusted files and write whole ones, whatever is in them."""
