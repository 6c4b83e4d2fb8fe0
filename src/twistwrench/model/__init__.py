"""Robots as frozen data, and the builder that checks them."""
