/* Runs one kernel on rows from standard input and writes its results: for tools/emulate.py, which defines
   KERNEL, REAL, SIZES (numbers per row of each array, the inputs first), STEPS (as NumPy's loops take them), INPUTS and ARRAYS. */
#include <stdio.h>
#include <stdlib.h>

extern void KERNEL(char **args, const long *dims, const long *steps, void *data);

int main(int argc, char **argv) {
    static const long sizes[] = {SIZES}, steps[] = {STEPS};
    const long rows = argc > 1 ? atol(argv[1]) : 0;
    char *args[ARRAYS];
    for (int k = 0; k < ARRAYS; k++) {
        const size_t bytes = (size_t)rows * sizes[k] * sizeof(REAL);
        args[k] = malloc(bytes ? bytes : 1);
        if (!args[k] || (k < INPUTS && fread(args[k], 1, bytes, stdin) != bytes)) return 1;
    }
    KERNEL(args, &rows, steps, 0);
    for (int k = INPUTS; k < ARRAYS; k++) fwrite(args[k], sizeof(REAL), (size_t)rows * sizes[k], stdout);
    return 0;
}
