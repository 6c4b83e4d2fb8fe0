"""Foundations without mechanics: argument checks, text, numbers, files."""
