"""ROS bags without ROS: topics, transforms and detections of ROS 1 bags, ROS 2 bags and MCAP files."""
