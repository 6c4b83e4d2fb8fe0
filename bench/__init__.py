"""One run, side by side, on one core: twistwrench and its peers. `python -m bench` writes RESULTS.md."""

import os

# One thread for everybody, said before NumPy is first imported.
os.environ.update({"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"})
