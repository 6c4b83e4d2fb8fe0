"""``python -m twistwrench`` is the command ``twistwrench``."""

from .cli.main import main

if __name__ == "__main__":
    main(prog_name="twistwrench")
