"""Fuzzing of every reader: changed files, read by child processes under limits of time, memory and places.

``python -m tests.fuzz --help`` runs one kind of files or all, and writes files that fail.
"""
