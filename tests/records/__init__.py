"""Answers on record: what a release said, so that no change alters an answer unseen."""
