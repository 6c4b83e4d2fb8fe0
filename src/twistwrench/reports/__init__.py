"""Reports on motions and robots: torques, limits, verdicts, summaries."""
