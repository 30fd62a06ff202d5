/* CoreMark on both parts: start-up, time by the core's cycle counter, output by semihosting. It prints what CoreMark
   checks and the cycles of an iteration, and fails if CoreMark finds an error. See docs/calibration.md. */
#include <stdarg.h>

#include "board.h"
#include "coremark.h"

volatile ee_s32 seed1_volatile = 0, seed2_volatile = 0, seed3_volatile = 0x66, seed4_volatile = ITERATIONS;
volatile ee_s32 seed5_volatile = 0;
ee_u32 default_num_contexts = 1;

static uint32_t began, ended;
static int validated;

/* CoreMark's report is not shown. It has this line if all results are right. */
int ee_printf(const char *format, ...)
{
    const char *line = "Correct operation validated", *at = format;
    while (*line && *at == *line)
        line++, at++;
    validated |= !*line;
    return 0;
}

void start_time(void) { began = CYCLES; }
void stop_time(void) { ended = CYCLES; }
CORE_TICKS get_time(void) { return ended - began; }

/* CoreMark wants ten seconds of real time; virtual time has no jitter, so any number of iterations will do. */
secs_ret time_in_secs(CORE_TICKS ticks) { return (void)ticks, 10; }

void portable_init(core_portable *p, int *argc, char *argv[])
{
    (void)argc, (void)argv;
    count_cycles();
#ifdef NRF52840
    REGISTER(0x4001E540) = CACHE;    /* NVMC.ICACHECNF */
#endif
#ifdef STM32F429
    REGISTER(0x40023840) |= 1 << 28;                                        /* RCC_APB1ENR: PWR */
    REGISTER(0x40007000) |= 3 << 14;                                        /* PWR_CR.VOS: scale 1 */
    REGISTER(0x40023804) = 8 | 180 << 6 | 4 << 24;                          /* PLL: HSI / 8 * 180 / 2 */
    REGISTER(0x40023800) |= 1 << 24;
    while (!(REGISTER(0x40023800) & 1 << 25)) {}
    REGISTER(0x40007000) |= 1 << 16;                                        /* PWR_CR.ODEN, then ODSWEN */
    while (!(REGISTER(0x40007004) & 1 << 16)) {}
    REGISTER(0x40007000) |= 1 << 17;
    while (!(REGISTER(0x40007004) & 1 << 17)) {}
    REGISTER(0x40023C00) = 5 | (CACHE ? 7 << 8 : 0);                        /* FLASH_ACR: latency, ART accelerator */
    REGISTER(0x40023808) = 5 << 10 | 4 << 13;                               /* APB1 / 4, APB2 / 2 */
    REGISTER(0x40023808) |= 2;
    while ((REGISTER(0x40023808) & 12) != 8) {}
#endif
    p->portable_id = 1;
}

void portable_fini(core_portable *p)
{
    p->portable_id = 0;
    print(validated ? "CoreMark validated its results\n" : "error: CoreMark did not validate its results\n");
    print_number((ended - began) / ITERATIONS);
    print(" cycles an iteration; CoreMark/MHz in thousandths: ");
    print_number((uint32_t)(1000000000ull * ITERATIONS / (ended - began)));
    print("\n");
    end(validated);
}
