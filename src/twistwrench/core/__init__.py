"""What every package stands on and that knows no mechanics: arguments checked, text, files."""
