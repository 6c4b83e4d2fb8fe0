"""Straight-line programs: traced from NumPy code on symbols, folded, fused, ordered. Knows no mechanics and no machine."""
