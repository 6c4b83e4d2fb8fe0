"""Search for exciting trajectories."""
