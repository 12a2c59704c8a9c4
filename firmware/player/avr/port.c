/* Port for an ATmega1284P: docs/board.md has the wiring.
 * SPDX-License-Identifier: MIT
 *
 * A DAC8562 (PB3) and an LTC1864 for each channel (PB4, PB2) on SPI at 8 MHz, lines at PC0 to PC2, an edge at PD2, and
 * a serial line of 500 kbit/s. */
#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "player.h"

#define DAC _BV(3)  /* of port B: selected while low */
#define ADC0 _BV(4) /* converts from its rising edge on, and is read while low */
#define ADC1 _BV(2)
#define MODE_ADC (_BV(SPE) | _BV(MSTR))            /* data are taken at the rising edge of the clock */
#define MODE_DAC (_BV(SPE) | _BV(MSTR) | _BV(CPHA)) /* at the falling edge */
#define DAC_SET 0x18       /* commands of the DAC: set a channel, which is added */
#define DAC_REFERENCE 0x38 /* switch on the internal reference */
#define LEAD 120           /* cycles from an edge to the compare match of the point that follows it */
/* Cycles from the compare match to the point: longer than other interrupts take that may come before it. */
#define SYNC (GPIOR0 & TOLD ? 240 : 140)
#define STEP _BV(0)        /* of GPIOR0: an edge is a point */
#define WAITS _BV(1)       /* an edge starts the clock */
#define TOLD _BV(2)        /* an edge is told to the core */
#define EDGES 16           /* a power of 2 */
#define RING 64            /* bytes from the host, a power of 2 */

static volatile uint8_t ring[RING], head, tail;
static volatile bool lost;
static volatile uint8_t milliseconds;
static volatile uint16_t overflows; /* of timer 3, which counts 4 us */
static struct {
    uint16_t low, high; /* time, in 4 us */
    bool used;
} edges[EDGES]; /* that are not told yet */
static volatile uint8_t edge_head, edge_tail;

static inline uint8_t spi(uint8_t byte)
{
    SPDR = byte;
    while (!(SPSR & _BV(SPIF)))
        ;
    return SPDR;
}

static inline void dac(uint8_t command, uint16_t value)
{
    PORTB &= (uint8_t)~DAC;
    spi(command);
    spi((uint8_t)(value >> 8));
    spi((uint8_t)value);
    PORTB |= DAC;
}

void port_exchange(const uint16_t *out, uint16_t *in)
{
    static const uint8_t adcs[] = {ADC0, ADC1};
    /* A conversion begins at a rising edge, and takes 3.2 us; setting an output takes longer. An ADC drives the common
     * line while it is low: never two at a time. */
    PORTB |= adcs[PORT_CHANNELS - 1];
    if (PORT_CHANNELS > 1) {
        PORTB &= (uint8_t)~ADC0;
        PORTB |= ADC0;
    }
    SPCR = MODE_DAC;
    for (uint8_t i = 0; i < PORT_CHANNELS; i++)
        dac(DAC_SET | i, out[i]);
    SPCR = MODE_ADC;
    for (uint8_t i = 0; i < PORT_CHANNELS; i++) {
        PORTB &= (uint8_t)~adcs[i];
        in[i] = (uint16_t)(spi(0) << 8);
        in[i] |= spi(0);
        if (i + 1 < PORT_CHANNELS)
            PORTB |= adcs[i];
    }
}

void port_lines(uint8_t lines)
{
    PORTC = lines;
}

void port_lock(void)
{
    cli();
}

void port_unlock(void)
{
    sei();
}

void port_send(uint8_t byte)
{
    while (!(UCSR0A & _BV(UDRE0)))
        ;
    UDR0 = byte;
}

void port_load_name(char *name)
{
    eeprom_read_block(name, 0, PORT_NAME_SIZE);
    name[PORT_NAME_SIZE] = 0;
    if ((uint8_t)name[0] == 0xFF) /* nothing was ever written */
        name[0] = 0;
}

void port_store_name(const char *name)
{
    wdt_reset(); /* writing a byte takes 3.4 ms */
    eeprom_update_block(name, 0, PORT_NAME_SIZE);
}

static void run_timer(uint16_t from)
{
    TCCR1B = _BV(WGM12) | _BV(CS10);
    TCNT1 = from; /* after the start: simavr does not take it before */
    TIFR1 = _BV(OCF1A);
    TIMSK1 = _BV(OCIE1A);
}

void port_clock_start(enum clock clock, uint32_t interval)
{
    OCR1A = (uint16_t)(interval - 1);
    if (clock == CLOCK_NOW) {
        run_timer(0);
        return;
    }
    if (!(GPIOR0 & TOLD))
        EIFR = _BV(INTF0);
    GPIOR0 |= clock == CLOCK_STEP_ON_EDGE ? STEP : WAITS;
    EIMSK = _BV(INT0);
}

void port_clock_stop(void)
{
    TCCR1B = 0;
    TIMSK1 = 0;
    GPIOR0 &= TOLD;
    if (!GPIOR0)
        EIMSK = 0;
}

void port_tell_edges(bool told)
{
    GPIOR0 = told ? TOLD : 0;
    edge_tail = edge_head;
    if (told) {
        EIFR = _BV(INTF0);
        EIMSK = _BV(INT0);
    }
}

/* Returns the part of the time that timer 3 has not, at one of its counts: it may just have gone through 0. */
static inline uint16_t high_at(uint16_t low)
{
    return overflows + (TIFR3 & _BV(TOV3) && !(low & 0x8000));
}

uint32_t port_us(void)
{
    cli();
    uint16_t low = TCNT3, high = high_at(low);
    sei();
    return ((uint32_t)high << 16 | low) << 2;
}

bool port_tick_is_due(void)
{
    return GPIOR0 & STEP ? EIFR & _BV(INTF0) : TIFR1 & _BV(OCF1A);
}

/* Waits for as many cycles as given, and some more that are always the same. */
static inline void wait_cycles(uint8_t n)
{
    __asm__ volatile("1: subi %0, 4\n\tnop\n\tbrcc 1b\n\t"     /* four at a time */
                     "sbrc %0, 0\n\trjmp .+0\n\t"              /* one */
                     "sbrc %0, 1\n\trjmp .+0\n\t"              /* two */
                     "sbrc %0, 1\n\trjmp .+0\n\t"
                     : "+d"(n));
}

ISR(TIMER1_COMPA_vect)
{
    /* Another interrupt, or a lock, may have delayed this one: wait for an instant that all points reach. */
    uint16_t since = TCNT1;
    if (since < SYNC)
        wait_cycles((uint8_t)(SYNC - since));
    player_tick(since >= SYNC);
}

/* Two interrupts in place of one: what only notes an edge must not save the registers that a point needs. */
ISR(INT0_vect, ISR_NAKED)
{
    __asm__ volatile("sbic %0, 0\n\trjmp __vector_step\n\trjmp __vector_edge" : : "I"(_SFR_IO_ADDR(GPIOR0)));
}

void __vector_step(void) __attribute__((signal, used));
void __vector_step(void)
{
    player_tick(false);
}

void __vector_edge(void) __attribute__((signal, used));
void __vector_edge(void)
{
    bool used = GPIOR0 & WAITS;
    if (used) {
        GPIOR0 &= (uint8_t)~WAITS;
        run_timer(OCR1A - LEAD); /* the point follows at once */
    }
    if (!(GPIOR0 & TOLD)) {
        EIMSK = 0;
        return;
    }
    uint8_t at = edge_head, free = (edge_tail - at - 1) & (EDGES - 1);
    if (free > !used) { /* the last place is for one that is used */
        edges[at].low = TCNT3;
        edges[at].high = high_at(edges[at].low);
        edges[at].used = used;
        edge_head = (at + 1) & (EDGES - 1);
    }
}

ISR(TIMER3_OVF_vect)
{
    overflows++;
}

ISR(TIMER0_COMPA_vect)
{
    milliseconds++;
}

ISR(USART0_RX_vect)
{
    uint8_t status = UCSR0A, byte = UDR0, next = (head + 1) & (RING - 1);
    if (status & (_BV(DOR0) | _BV(FE0)) || next == tail)
        lost = true;
    if (next != tail) {
        ring[head] = byte;
        head = next;
    }
}

/* After a reset by the watchdog it goes on with its shortest time: it has to be stopped before anything else. */
void stop_watchdog(void) __attribute__((naked, used, section(".init3")));
void stop_watchdog(void)
{
    MCUSR = 0;
    wdt_disable();
}

static void start(void)
{
    PORTB = DAC | ADC1;
    DDRB = DAC | ADC0 | ADC1 | _BV(5) | _BV(7);
    SPSR = _BV(SPI2X);
    player_start();
    SPCR = MODE_DAC;
    dac(DAC_REFERENCE, 1);
    DDRC = LINE_POINT | LINE_LINE | LINE_FRAME | LINE_PLAY;
    PORTD = _BV(2) | _BV(0); /* pull-ups */
    EICRA = _BV(ISC01) | _BV(ISC00);
    UBRR0 = 1;
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
    TCCR0A = _BV(WGM01);
    TCCR0B = _BV(CS01) | _BV(CS00);
    OCR0A = 249;
    TIMSK0 = _BV(OCIE0A);
    TCCR3B = _BV(CS31) | _BV(CS30);
    TIMSK3 = _BV(TOIE3);
    wdt_enable(WDTO_250MS); /* a main loop that hangs, or has no time left beside the points, ends in a reset */
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
}

static void sleep_until_interrupt(uint8_t known_ms)
{
    cli();
    if (head == tail && edge_head == edge_tail && milliseconds == known_ms) {
        sleep_enable();
        sei(); /* takes effect behind the next instruction: no interrupt is missed in between */
        sleep_cpu();
        sleep_disable();
    }
    sei();
}

int main(void)
{
    uint8_t known_ms = 0;
    start();
    for (;;) {
        wdt_reset();
        while (head != tail) {
            uint8_t byte = ring[tail];
            tail = (tail + 1) & (RING - 1);
            player_byte(byte);
        }
        if (lost) {
            lost = false;
            player_overrun();
        }
        while (edge_head != edge_tail) {
            uint8_t at = edge_tail;
            player_edge(((uint32_t)edges[at].high << 16 | edges[at].low) << 2, edges[at].used);
            edge_tail = (at + 1) & (EDGES - 1);
        }
        while (known_ms != milliseconds) {
            known_ms++;
            player_millisecond();
        }
        sleep_until_interrupt(known_ms);
    }
}
