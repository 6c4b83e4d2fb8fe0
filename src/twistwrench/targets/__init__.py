"""One emitter per target, each from the same program."""
