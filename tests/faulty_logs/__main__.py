"""``python -m tests.faulty_logs``: see :mod:`.runs`."""

from .runs import main

if __name__ == "__main__":
    main()
