"""From traced programs to machine code: their text, its lowering and printing, and the functions that run it."""
