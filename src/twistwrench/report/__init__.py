"""What the shell reads, prints, draws and writes: motion files in, torque reports out."""
