"""Checks of the rows and columns of a log: time stamps, mimic joints, conventions of the programs that write it."""
