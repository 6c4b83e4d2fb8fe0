"""One run, side by side, on one core: twistwrench and its peers. `python -m bench` writes RESULTS.md."""
