"""Faulty logs of known robots, with their truth; ``python -m tests.faulty_logs`` scores what the program says of them."""
