/* Port for an RP2040: docs/board.md has the wiring.
 * SPDX-License-Identifier: MIT
 *
 * A DAC8562 (GPIO17) and an LTC1864 for each channel (GPIO20, 21) on SPI at 6.9 MHz, lines at GPIO2 to 5, an edge at
 * GPIO6, and a serial line of 500 kbit/s at GPIO0 and 1. Points and edges interrupt the main loop; a point interrupts
 * also what notes an edge. */
#include "player.h"
#include "rp2040.h"

enum { TX, RX, LINES, EDGE = 6, MISO = 16, DAC, SCK, MOSI, ADC0, ADC1 };
#define BIT(pin) (1u << (pin))
#define ALL_LINES (LINE_POINT | LINE_LINE | LINE_FRAME | LINE_PLAY)
#define MODE_DAC (7 | 1 << 7) /* 8 bits, which are taken at the falling edge of the clock */
#define MODE_ADC 15           /* 16 bits, at the rising edge */
#define SPI_DIVIDER 18        /* 24 bits take longer than the conversion of the ADC, which is 3.2 us */
#define DAC_SET 0x18          /* commands of the DAC: set a channel, which is added */
#define DAC_REFERENCE 0x38    /* switch on the internal reference */
#define COUNTER 1             /* the slice of the PWM that gives the points */
#define SYNC 5                /* its counts from the wrap to the point: longer than a lock */
#define RISING (8u << 4 * EDGE)
#define WATCHDOG_US 250000
#define ERASE_US 2000000 /* more than a chip takes to erase a sector of flash */
#define NAME_AT 0x10000  /* in flash: a sector of its own */
#define EDGES 16         /* a power of 2 */

static volatile enum clock awaited; /* what the next edge does; CLOCK_NOW: nothing */
static volatile bool told;          /* whether edges are told to the core */
static volatile struct {
    uint32_t us;
    bool used;
} edges[EDGES]; /* that are not told yet */
static volatile uint32_t edge_head, edge_tail;
static char stored_name[PORT_NAME_SIZE + 1];

static void spi_mode(uint32_t mode)
{
    SPI_CR1 = 0;
    SPI_CR0 = mode;
    SPI_CR1 = SPI_ENABLE;
}

/* Waits for the end of a transfer; returns what was received last. */
static uint32_t spi_end(void)
{
    uint32_t last = 0;
    while (SPI_SR & SPI_BUSY)
        ;
    while (SPI_SR & SPI_NOT_EMPTY)
        last = SPI_DR;
    return last;
}

/* As long as the converters need a level, at least. */
static inline void wait_100_ns(void)
{
    __asm__ volatile(".rept 13\n\tnop\n\t.endr");
}

static void dac(uint32_t command, uint16_t value)
{
    GPIO_CLR = BIT(DAC);
    SPI_DR = command;
    SPI_DR = value >> 8;
    SPI_DR = value & 0xFF;
    spi_end();
    GPIO_SET = BIT(DAC);
    wait_100_ns();
}

void port_exchange(const uint16_t *out, uint16_t *in)
{
    /* A conversion begins at a rising edge. An ADC drives the common line while it is low: never two at a time. */
    for (uint32_t i = 0; i < PORT_CHANNELS; i++) {
        GPIO_CLR = BIT(ADC0 + i);
        wait_100_ns();
        GPIO_SET = BIT(ADC0 + i);
    }
    spi_mode(MODE_DAC);
    for (uint32_t i = 0; i < PORT_CHANNELS; i++)
        dac(DAC_SET | i, out[i]);
    spi_mode(MODE_ADC);
    for (uint32_t i = 0; i < PORT_CHANNELS; i++) {
        GPIO_CLR = BIT(ADC0 + i);
        SPI_DR = 0;
        in[i] = (uint16_t)spi_end();
        GPIO_SET = BIT(ADC0 + i);
    }
}

void port_lines(uint8_t lines)
{
    GPIO_SET = (uint32_t)lines << LINES;
    GPIO_CLR = (uint32_t)(ALL_LINES & ~lines) << LINES;
}

void port_lock(void)
{
    __asm__ volatile("cpsid i" : : : "memory");
}

void port_unlock(void)
{
    __asm__ volatile("cpsie i" : : : "memory");
}

void port_send(uint8_t byte)
{
    while (UART_FR & UART_TX_FULL)
        ;
    UART_DR = byte;
}

void port_load_name(char *name)
{
    for (uint32_t i = 0; i <= PORT_NAME_SIZE; i++)
        name[i] = stored_name[i];
}

/* Returns a function of the boot ROM. */
static void *rom(char first, char second)
{
    extern const uint16_t rom_functions, rom_lookup; /* of the linker */
    void *(*lookup)(uint32_t table, uint32_t code) = (void *(*)(uint32_t, uint32_t))(uint32_t)rom_lookup;
    return lookup(rom_functions, (uint32_t)second << 8 | (uint32_t)first);
}

void port_store_name(const char *name)
{
    static uint8_t page[256];
    for (uint32_t i = 0; i <= PORT_NAME_SIZE; i++) {
        stored_name[i] = name[i];
        page[i] = (uint8_t)name[i];
    }
    WATCHDOG_LOAD = 2 * ERASE_US;
    ((void (*)(void))rom('I', 'F'))(); /* the pins of flash; then an end to its reading as memory */
    ((void (*)(void))rom('E', 'X'))();
    ((void (*)(uint32_t, uint32_t, uint32_t, uint8_t))rom('R', 'E'))(NAME_AT, 4096, 65536, 0xD8);
    ((void (*)(uint32_t, const uint8_t *, uint32_t))rom('R', 'P'))(NAME_AT, page, sizeof page);
}

static void run_counter(uint32_t from)
{
    PWM_CTR = from;
    PWM_INTR = COUNTER;
    PWM_INTE = COUNTER;
    PWM_CSR = 1;
}

void port_clock_start(enum clock clock, uint32_t interval)
{
    PWM_TOP = interval - 1;
    awaited = clock;
    if (clock == CLOCK_NOW) {
        run_counter(0);
        return;
    }
    if (!told)
        IO_INTR0 = RISING;
    IO_INTE0 = RISING;
}

void port_clock_stop(void)
{
    awaited = CLOCK_NOW;
    IO_INTE0 = told ? RISING : 0;
    PWM_CSR = 0;
    PWM_INTE = 0;
}

void port_tell_edges(bool tell)
{
    told = tell;
    edge_tail = edge_head;
    IO_INTR0 = RISING;
    IO_INTE0 = tell ? RISING : 0;
}

uint32_t port_us(void)
{
    return TIMER_RAWL;
}

bool port_tick_is_due(void)
{
    return awaited == CLOCK_STEP_ON_EDGE ? IO_INTR0 & RISING : PWM_INTR & COUNTER;
}

void on_pwm(void)
{
    /* A lock may have delayed this: wait for an instant that all points reach. */
    uint32_t since = PWM_CTR;
    PWM_INTR = COUNTER;
    while (PWM_CTR < SYNC)
        ;
    player_tick(since >= SYNC);
}

void on_io(void)
{
    uint32_t us = TIMER_RAWL;
    bool used = awaited == CLOCK_START_ON_EDGE;
    IO_INTR0 = RISING;
    if (awaited == CLOCK_STEP_ON_EDGE) {
        player_tick(false);
        return;
    }
    if (!told)
        IO_INTE0 = 0;
    uint32_t at = edge_head, free = (edge_tail - at - 1) & (EDGES - 1);
    if (told && free > !used) { /* the last place is for one that is used */
        edges[at].us = us;
        edges[at].used = used;
        edge_head = (at + 1) & (EDGES - 1);
    }
    if (used) {
        awaited = CLOCK_NOW;
        run_counter(PWM_TOP - 1); /* the point follows at once */
    }
}

static void load_name(void)
{
    const volatile char *flash = (const volatile char *)(FLASH + NAME_AT);
    for (uint32_t i = 0; i < PORT_NAME_SIZE && flash[0] != (char)0xFF; i++)
        stored_name[i] = flash[i];
}

static void make_safe(void)
{
    CLK_PERI_CTRL = 1u << 11; /* the clock of the processor, which is now some 6 MHz */
    release(RESET_IO_BANK0 | RESET_PADS_BANK0 | RESET_SPI0);
    GPIO_SET = BIT(DAC) | BIT(ADC0) | BIT(ADC1);
    GPIO_OE_SET = BIT(DAC) | BIT(ADC0) | BIT(ADC1) | ALL_LINES << LINES;
    GPIO_CTRL(DAC) = GPIO_CTRL(ADC0) = GPIO_CTRL(ADC1) = PIN_SIO;
    GPIO_CTRL(MISO) = GPIO_CTRL(SCK) = GPIO_CTRL(MOSI) = PIN_SPI;
    PAD(MISO) = PAD_INPUT;
    SPI_CPSR = SPI_DIVIDER;
    player_start();
    spi_mode(MODE_DAC);
    dac(DAC_REFERENCE, 1);
}

static void start_rest(void)
{
    start_clocks();
    release(RESET_PWM | RESET_TIMER | RESET_UART0);
    for (uint32_t pin = LINES; pin <= EDGE; pin++)
        GPIO_CTRL(pin) = PIN_SIO;
    PAD(EDGE) = PAD(RX) = PAD_INPUT;
    GPIO_CTRL(TX) = GPIO_CTRL(RX) = PIN_UART;
    UART_IBRD = 15; /* 125 MHz / 16 / 15.625 */
    UART_FBRD = 40;
    UART_LCR_H = 0x70;
    UART_CR = 0x301;
    PWM_DIV = 25 << 4;
    NVIC_IPR3 = 3u << 14; /* the lowest priority for IRQ_IO */
    NVIC_ISER = BIT(IRQ_PWM) | BIT(IRQ_IO);
    PSM_WDSEL = 0x1FFFC; /* all but the oscillators */
    WATCHDOG_LOAD = 2 * WATCHDOG_US; /* it counts down twice in a microsecond */
    WATCHDOG_CTRL = 1u << 30;
}

int main(void)
{
    make_safe();
    load_name();
    start_rest();
    uint32_t millisecond = TIMER_RAWL;
    for (;;) {
        WATCHDOG_LOAD = 2 * WATCHDOG_US;
        if (!(UART_FR & UART_RX_EMPTY)) {
            uint32_t got = UART_DR;
            if (got & (UART_FRAMING | UART_OVERRUN))
                player_overrun();
            player_byte((uint8_t)got);
        }
        while (edge_head != edge_tail) {
            uint32_t at = edge_tail;
            player_edge(edges[at].us, edges[at].used);
            edge_tail = (at + 1) & (EDGES - 1);
        }
        if (TIMER_RAWL - millisecond >= 1000) {
            millisecond += 1000;
            player_millisecond();
        }
    }
}
