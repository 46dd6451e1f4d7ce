"""Old and new poses together: the update of a result, and the difference of two."""
