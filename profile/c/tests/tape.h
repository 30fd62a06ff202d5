/* Plays a tape against the C client and writes down what it says. See tape.c. */
#ifndef HORUS_DPR_TAPE_H
#define HORUS_DPR_TAPE_H

#include <stddef.h>
#include <stdint.h>

/* Takes `count` characters of what is written down. */
typedef void (*horus_dpr_sink_t)(void *context, const char *text, size_t count);

void horus_dpr_play(const uint8_t *tape, size_t count, horus_dpr_sink_t sink, void *context);

#endif
