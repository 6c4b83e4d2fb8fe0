"""What stands above a CUDA kernel: the words of CUDA and of C++, and functions that copy rows through shared memory."""

from __future__ import annotations

PRELUDE = """\
#define THREADS {threads}u

#ifdef __CUDACC__
#define SHARED __shared__ __align__(16)
#define EACH_BLOCK(block, blocks) if (const long long block = blockIdx.x; block < (blocks))
#define EACH_THREAD(t) if (const unsigned t = threadIdx.x; t < THREADS)
#define TOGETHER __syncthreads()
#define SINCOS(x, s, c) sincos{suffix}((x), (s), (c))
#define UNROLLED _Pragma("unroll 16")
#define INLINE static __device__ __forceinline__
#else /* the same on a processor: block after block, and in each what stands between two TOGETHER thread after thread */
#include <math.h>
#define __global__
#define __device__
#define __restrict__
#define __launch_bounds__(threads)
#define SHARED static
#define EACH_BLOCK(block, blocks) for (long long block = 0; block < (blocks); block++)
#define EACH_THREAD(t) for (unsigned t = 0; t < THREADS; t++)
#define TOGETHER
#define SINCOS(x, s, c) (*(s) = sin{suffix}(x), *(c) = cos{suffix}(x))
#define UNROLLED
#define INLINE static inline
#endif
"""

PLACE = """\
/* Where element i of rows of n elements lies in a tile: rows begin an odd number of elements apart, for the banks' sake. */
template <unsigned n> INLINE unsigned place(unsigned i) {{ return n % 2 ? i : i + i / n; }}
"""

ROWS_IN = """\
/* Rows of n elements, `step` elements apart, into a tile. */
template <unsigned n>
INLINE void whole_rows_in(unsigned t, {real} *tile, const {real} *__restrict__ from)
{{
    UNROLLED
    for (unsigned k = 0; k < n; k++)
        tile[place<n>(t + k * THREADS)] = from[t + k * THREADS];
}}

template <unsigned n>
INLINE void rows_in(unsigned t, unsigned rows, {real} *tile, const {real} *__restrict__ from, long long step)
{{
    if (rows == THREADS && step == n)
        whole_rows_in<n>(t, tile, from);
    else
        for (unsigned i = t; i < rows * n; i += THREADS)
            tile[place<n>(i)] = from[i / n * step + i % n];
}}
"""

ROWS_OUT = """\
/* Rows of n elements out of a tile, without gaps. */
template <unsigned n>
INLINE void rows_out(unsigned t, unsigned rows, const {real} *tile, {real} *__restrict__ to)
{{
    if (rows == THREADS) {{
        UNROLLED
        for (unsigned k = 0; k < n; k++)
            to[t + k * THREADS] = tile[place<n>(t + k * THREADS)];
    }} else
        for (unsigned i = t; i < rows * n; i += THREADS)
            to[i] = tile[place<n>(i)];
}}
"""

TABLE_OUT = """\
/* The same where equal elements are kept once: element k of a row is number table[k] of what is kept, in rows `pitch` apart. */
template <unsigned n, unsigned pitch>
INLINE void table_out(
    unsigned t, unsigned rows, const {real} *tile, const unsigned short *table, {real} *__restrict__ to)
{{
    for (unsigned i = t; i < rows * n; i += THREADS)
        to[i] = tile[i / n * pitch + table[i % n]];
}}
"""
