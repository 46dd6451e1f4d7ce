"""Numbers that many packages share: statistical levels, rounding errors, limits of input and of text."""
