/* Runs one kernel on rows from standard input and writes its results: for tools/emulate.py, which defines
   KERNEL, REAL, SIZES (numbers per row of each array, the inputs first), STEPS (as NumPy's loops take them), INPUTS and ARRAYS. */
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#endif

extern void KERNEL(char **args, const ptrdiff_t *dims, const ptrdiff_t *steps, void *data);

int main(int argc, char **argv) {
    static const ptrdiff_t sizes[] = {SIZES}, steps[] = {STEPS};
    const ptrdiff_t rows = argc > 1 ? atol(argv[1]) : 0;
    char *args[ARRAYS];
#ifdef _WIN32
    _setmode(_fileno(stdin), _O_BINARY);
    _setmode(_fileno(stdout), _O_BINARY);
#endif
    for (int k = 0; k < ARRAYS; k++) {
        const size_t bytes = (size_t)rows * sizes[k] * sizeof(REAL);
        args[k] = malloc(bytes ? bytes : 1);
        if (!args[k] || (k < INPUTS && fread(args[k], 1, bytes, stdin) != bytes)) return 1;
    }
    KERNEL(args, &rows, steps, 0);
    for (int k = INPUTS; k < ARRAYS; k++) fwrite(args[k], sizeof(REAL), (size_t)rows * sizes[k], stdout);
    return 0;
}
