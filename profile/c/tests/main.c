/* Plays the tape on standard input; writes the client's output to standard output. */
#include <stdio.h>
#include <stdlib.h>

#include "tape.h"

static void write_out(void *context, const char *text, size_t count)
{
    (void)fwrite(text, 1U, count, (FILE *)context);
}

int main(void)
{
    size_t capacity = (size_t)1U << 20U;
    size_t count = 0U;
    size_t got;
    uint8_t *tape = malloc(capacity);
    while (tape != NULL) {
        got = fread(&tape[count], 1U, capacity - count, stdin);
        count += got;
        if (got == 0U) {
            break;
        }
        if (count == capacity) {
            uint8_t *const longer = realloc(tape, capacity * 2U);
            if (longer == NULL) {
                free(tape);
            }
            tape = longer;
            capacity *= 2U;
        }
    }
    if (tape == NULL) {
        (void)fputs("no memory\n", stderr);
        return EXIT_FAILURE;
    }
    horus_dpr_play(tape, count, write_out, stdout);
    free(tape);
    return (fflush(stdout) == 0) ? EXIT_SUCCESS : EXIT_FAILURE;
}
