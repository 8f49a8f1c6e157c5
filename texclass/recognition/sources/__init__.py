"""Where the samples of a stream come from: standard input, recordings, bags, ROS 2 topics."""
