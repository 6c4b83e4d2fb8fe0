"""Programs as source text: C99 and CUDA C++."""
