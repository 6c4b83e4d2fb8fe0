"""Readers of foreign log files, each bounded, the ones with foreign C code in a child process."""
