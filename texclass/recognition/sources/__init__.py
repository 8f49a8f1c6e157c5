"""Sources of streams: standard input, recordings, bags and ROS 2 topics."""
