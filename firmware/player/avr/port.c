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
#define SYNC 140           /* cycles from the compare match to the point: longer than any other interrupt takes */
#define RING 64            /* bytes from the host, a power of 2 */

static volatile uint8_t ring[RING], head, tail;
static volatile bool lost;
static volatile uint8_t milliseconds;
static enum clock clock_in_use;

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
    TCNT1 = from;
    TIFR1 = _BV(OCF1A);
    TIMSK1 = _BV(OCIE1A);
    TCCR1B = _BV(WGM12) | _BV(CS10);
}

void port_clock_start(enum clock clock, uint32_t interval)
{
    clock_in_use = clock;
    OCR1A = (uint16_t)(interval - 1);
    if (clock == CLOCK_NOW) {
        run_timer(0);
    } else {
        EIFR = _BV(INTF0);
        EIMSK = _BV(INT0);
    }
}

void port_clock_stop(void)
{
    TCCR1B = 0;
    TIMSK1 = 0;
    EIMSK = 0;
}

bool port_tick_is_due(void)
{
    return clock_in_use == CLOCK_STEP_ON_EDGE ? EIFR & _BV(INTF0) : TIFR1 & _BV(OCF1A);
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

ISR(INT0_vect)
{
    if (clock_in_use == CLOCK_STEP_ON_EDGE) {
        player_tick(false);
    } else {
        EIMSK = 0;
        run_timer(OCR1A - 20); /* the first point follows at once */
    }
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
    wdt_enable(WDTO_250MS); /* a main loop that hangs, or has no time left beside the points, ends in a reset */
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
}

static void sleep_until_interrupt(uint8_t known_ms)
{
    cli();
    if (head == tail && milliseconds == known_ms) {
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
        while (known_ms != milliseconds) {
            known_ms++;
            player_millisecond();
        }
        sleep_until_interrupt(known_ms);
    }
}
