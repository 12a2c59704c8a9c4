/* From the reset of an RP2040 to main, and its clocks. Data sheet: 2.8 boot, 4.10 SSI, 2.15 to 2.18 clocks.
 * SPDX-License-Identifier: MIT
 *
 * The firmware is copied from flash to RAM once and runs there: no access to flash delays a point, and flash can be
 * written. */
#include "rp2040.h"

#define BOOT2_BYTES 256

extern uint32_t image_begin[], image_end[], bss_begin[], bss_end[], stack_top[]; /* of the linker */

/* The boot ROM copies this to RAM, checks its CRC and calls it. It reads flash by the command 03h, which each chip
 * knows, at a half of the clock after the reset, some 3 MHz. */
__attribute__((section(".boot2"), used, noreturn)) void boot2(void)
{
    const volatile uint32_t *from = (const volatile uint32_t *)(FLASH + BOOT2_BYTES);
    SSI_SSIENR = 0;
    SSI_SER = 1;
    SSI_BAUDR = 2;
    SSI_CTRLR0 = 31u << 16 | 3u << 8;                 /* 32 bits of data, behind a command */
    SSI_SPI_CTRLR0 = 0x03u << 24 | 2u << 8 | 6u << 2; /* the command of 8 bits, the address of 24 */
    SSI_CTRLR1 = 0;
    SSI_SSIENR = 1;
    for (volatile uint32_t *to = image_begin; to != image_end; to++)
        *to = *from++;
    __asm__ volatile("msr msp, %0\n\tbx %1" : : "r"(image_begin[0]), "r"(image_begin[1]));
    __builtin_unreachable();
}

static void start(void)
{
    for (volatile uint32_t *word = bss_begin; word != bss_end; word++)
        *word = 0;
    VTOR = (uint32_t)image_begin;
    main();
}

/* A program that has gone astray waits for the watchdog. */
static void hang(void)
{
    for (;;)
        ;
}

__attribute__((section(".vectors"), used)) static void (*const vectors[16 + 26])(void) = {
    (void (*)(void))stack_top, start, hang, hang,
    [11] = hang, [14] = hang, hang, [16 + IRQ_PWM] = on_pwm, [16 + IRQ_IO] = on_io,
};

/* The compiler itself calls these two. */
__attribute__((used)) void *memset(void *to, int value, size_t n)
{
    for (uint8_t *byte = to; n; n--)
        *byte++ = (uint8_t)value;
    return to;
}

__attribute__((used)) void *memcpy(void *to, const void *from, size_t n)
{
    const uint8_t *source = from;
    for (uint8_t *byte = to; n; n--)
        *byte++ = *source++;
    return to;
}

void release(uint32_t parts)
{
    CLR(RESETS_RESET) = parts;
    while ((RESETS_DONE & parts) != parts)
        ;
}

void start_clocks(void)
{
    XOSC_CTRL = 0xAA0;    /* 1 to 15 MHz */
    XOSC_STARTUP = 470;   /* times 256 periods: 10 ms */
    SET(XOSC_CTRL) = 0xFABu << 12;
    while (!(XOSC_STATUS & 1u << 31))
        ;
    CLK_REF_CTRL = 2; /* the crystal */
    while (!(CLK_REF_SELECTED & 1u << 2))
        ;
    WATCHDOG_TICK = 1u << 9 | 12; /* 1 MHz */

    release(RESET_PLL_SYS);
    PLL_SYS_CS = 1;
    PLL_SYS_FBDIV = 125;            /* 1500 MHz */
    CLR(PLL_SYS_PWR) = 1 | 1 << 5;  /* power of the PLL and of its oscillator */
    while (!(PLL_SYS_CS & 1u << 31))
        ;
    PLL_SYS_PRIM = 6u << 16 | 2u << 12; /* divided by 12 */
    CLR(PLL_SYS_PWR) = 1 << 3;
    CLK_SYS_CTRL = 0;
    CLK_SYS_CTRL = 1;
    while (!(CLK_SYS_SELECTED & 2))
        ;
}
