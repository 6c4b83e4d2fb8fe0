"""What the shell prints, draws and writes: motion files in, torque reports out. Nothing is imported until it is used."""
