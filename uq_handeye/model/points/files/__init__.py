"""Files of points: tables of points and targets, folders of poses from points."""
