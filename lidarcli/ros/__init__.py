"""ROS messages as they are written: their definitions, LaserScan as bytes, and how topics are offered."""
