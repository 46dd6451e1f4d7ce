"""A rig in use: what new views say of it, where things will be, which views to take next, new views taken in."""
