"""Shapes of links: surfaces and their meshes, what a file draws, and solids and capsules made from them."""
