"""Camera poses from pictures of a scene without a board: structure from motion, with its covariance and the robot."""
