"""Machine code in this process: compilation, loading, calls, threads and memory of results."""
