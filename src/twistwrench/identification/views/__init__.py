"""Reports of identifications and of exciting motions, in blocks."""
