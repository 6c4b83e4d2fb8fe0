"""Pictures of results, one style for all."""
