"""Two streams with unsynchronised clocks."""
