"""The mechanics of the book: screws, bodies, joints, models and the algorithms of chapter 8, each on what stands before it."""
