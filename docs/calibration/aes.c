/* AES-128 by P. Schwabe and K. Stoffelen (github.com/Ko-/aes-armcortexm) on the STM32F429 without wait states, as its
   authors measured it: cycles of the key schedule, and of a block. See docs/calibration.md. */
#include "board.h"

#define BLOCKS 256

/* FIPS 197, appendix B. */
static const uint8_t key[16] = {0x2b, 0x7e, 0x15, 0x16, 0x28, 0xae, 0xd2, 0xa6,
                                0xab, 0xf7, 0x15, 0x88, 0x09, 0xcf, 0x4f, 0x3c};
static const uint8_t plain[16] = {0x32, 0x43, 0xf6, 0xa8, 0x88, 0x5a, 0x30, 0x8d,
                                  0x31, 0x31, 0x98, 0xa2, 0xe0, 0x37, 0x07, 0x34};
static const uint8_t cipher[16] = {0x39, 0x25, 0x84, 0x1d, 0x02, 0xdc, 0x09, 0xfb,
                                   0xdc, 0x11, 0x85, 0x97, 0x19, 0x6a, 0x0b, 0x32};

void AES_128_keyschedule(const uint8_t *, uint8_t *);
#ifdef SINGLE
void AES_128_encrypt(const uint8_t *, const uint8_t *, uint8_t *);
#else
struct parameters {
    uint32_t counter;
    uint8_t nonce[12];
    uint8_t keys[2 * 11 * 16];
};
void AES_128_encrypt_ctr(const struct parameters *, const uint8_t *, uint8_t *, uint32_t);
static struct parameters with;
static uint8_t in[16 * BLOCKS], out[16 * BLOCKS], again[16 * BLOCKS];
#endif

static void tell(const char *what, uint32_t tenths)
{
    print(what);
    print_number(tenths / 10);
    print(".");
    print_number(tenths % 10);
    print(" cycles\n");
}

int main(void)
{
    REGISTER(0x40023C00) = 7 << 8; /* FLASH_ACR: prefetch and caches, no wait states up to 30 MHz; HSI runs at 16 MHz */
    count_cycles();
    int passed = 1;
#ifdef SINGLE
    static uint8_t keys[11 * 16], out[16];
    for (int i = 0; i < 16; i++)
        keys[i] = key[i];
    uint32_t began = CYCLES;
    AES_128_keyschedule(key, keys + 16);
    uint32_t scheduled = CYCLES;
    AES_128_encrypt(keys, plain, out);
    uint32_t ended = CYCLES;
    for (int i = 0; i < 16; i++)
        passed &= out[i] == cipher[i];
    tell("key schedule ", 10 * (scheduled - began));
    tell("single block ", 10 * (ended - scheduled));
#else
    (void)plain, (void)cipher;
    for (int i = 0; i < 16; i++)
        with.keys[i] = key[i];
    for (int i = 0; i < 16 * BLOCKS; i++)
        in[i] = i;
    uint32_t began = CYCLES;
    AES_128_keyschedule(key, with.keys + SCHEDULE_AT);
    uint32_t scheduled = CYCLES;
    AES_128_encrypt_ctr(&with, in, out, sizeof in);
    uint32_t ended = CYCLES;
    /* The functions count on, in the first word or, bitsliced, in the last. Both were 0. */
    with.counter = 0;
    for (int i = 0; i < 12; i++)
        with.nonce[i] = 0;
    AES_128_encrypt_ctr(&with, out, again, sizeof out);
    for (int i = 0; i < 16 * BLOCKS; i++)
        passed &= again[i] == in[i];
    passed &= out[0] != in[0] || out[1] != in[1];
    tell("key schedule ", 10 * (scheduled - began));
    tell("block in counter mode ", 10 * (ended - scheduled) / BLOCKS);
#endif
    print(passed ? "" : "error: the result is wrong\n");
    end(passed);
    return 0;
}
