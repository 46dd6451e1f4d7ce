"""What is measured and its errors: noise, poses, arms, errors that all poses share, cameras, points."""
