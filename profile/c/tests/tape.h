/* Plays a tape to the C client and writes its output. See tape.c. */
#ifndef HORUS_DPR_TAPE_H
#define HORUS_DPR_TAPE_H

#include <stddef.h>
#include <stdint.h>

/* Takes `count` characters of the output. */
typedef void (*horus_dpr_sink_t)(void *context, const char *text, size_t count);

void horus_dpr_play(const uint8_t *tape, size_t count, horus_dpr_sink_t sink, void *context);

#endif
