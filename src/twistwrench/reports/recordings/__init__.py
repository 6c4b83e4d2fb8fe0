"""Recordings of motions for other viewers: ROS 2 messages in MCAP files, and .rrd files of rerun."""
