"""Inverse kinematics: the search for configurations of poses, its result, and all branches."""
