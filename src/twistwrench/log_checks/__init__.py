"""Checks of logs: the table of doubts, and those of motions and of residuals of an identified robot."""
