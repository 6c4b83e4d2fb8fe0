"""Answers as objects: verdict, blocks, and the surfaces that show them: text, card, page and data."""
