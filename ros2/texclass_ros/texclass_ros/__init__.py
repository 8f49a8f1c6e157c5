"""ROS 2 node that classifies surfaces with texclass."""
