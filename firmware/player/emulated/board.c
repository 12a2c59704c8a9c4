/* The board around an emulated ATmega1284P, for `piezod emulate board`: converters, serial line, edge and lines.
 * SPDX-License-Identifier: MIT
 *
 * Python calls it by ctypes (piezod_drivers.serial_line.piezo_board.emulation). It needs simavr 1.6 or newer. */
#include <simavr/avr_eeprom.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_spi.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_time.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

enum { CLOCK_HZ = 16000000, BYTE_CYCLES = 320 };
enum { SPI_CYCLES = 16, QUIET_CYCLES = 4 * BYTE_CYCLES, RING = 65536 };
enum { SPDR = 0x4E, SPSR = 0x4D, SPCR = 0x4C, CPHA = 0x04, SPIF = 0x80 };

typedef void (*drive_t)(int channel, unsigned count, uint64_t cycle);
typedef unsigned (*sense_t)(int channel, uint64_t cycle);

/* What the converters and the lines have seen. The instants of a play are those at which an output changes. */
struct seen {
    uint64_t points, lines, frames, bad_frames, sets;
    uint64_t shortest, longest; /* cycles between two updates of the output within a play */
};

struct board {
    avr_t *avr;
    const avr_uart_t *uart;
    drive_t drive;
    sense_t sense;
    struct seen seen;
    uint8_t dac_selected, converting[2], n_dac, n_adc, dac_bytes[3];
    uint16_t sample[2];
    int reads;              /* channel whose sample is shifted out */
    uint8_t spi_out, spi_in;
    uint8_t plays;
    uint64_t last_set;
    uint64_t next_byte;     /* cycle at which the next byte from the host is complete */
    int may_send;           /* the receiver has room */
    uint64_t edge_every;
    unsigned edges_left;
    uint8_t in[RING], out[RING];
    unsigned in_head, in_tail, out_n;
    char firmware[4096], name[9];
};

/* simavr 1.6 makes every byte on SPI 100 us long, whatever the clock: these three functions take its place. */
static avr_cycle_count_t spi_done(avr_t *avr, avr_cycle_count_t when, void *param)
{
    struct board *b = param;
    uint8_t phase = avr->data[SPCR] & CPHA;
    (void)when;
    b->spi_in = 0xFF;
    if (b->dac_selected && phase && b->n_dac < 3)
        b->dac_bytes[b->n_dac++] = b->spi_out;
    else if (b->dac_selected)
        b->n_dac = 4; /* too many bytes, or taken at the wrong edge */
    else if (b->reads >= 0 && !phase && b->n_adc < 2)
        b->spi_in = (uint8_t)(b->sample[b->reads] >> (b->n_adc++ ? 0 : 8));
    avr->data[SPSR] |= SPIF;
    return 0;
}

static void spi_write(avr_t *avr, avr_io_addr_t addr, uint8_t value, void *param)
{
    struct board *b = param;
    (void)addr;
    avr->data[SPSR] &= (uint8_t)~SPIF;
    b->spi_out = value;
    avr_cycle_timer_register(avr, SPI_CYCLES, spi_done, b);
}

static uint8_t spi_read(avr_t *avr, avr_io_addr_t addr, void *param)
{
    (void)addr;
    avr->data[SPSR] &= (uint8_t)~SPIF;
    return ((struct board *)param)->spi_in;
}

static void note_set(struct board *b)
{
    uint64_t cycle = b->avr->cycle;
    b->seen.sets++;
    if (b->plays) {
        if (b->last_set) {
            uint64_t since = cycle - b->last_set;
            if (since < b->seen.shortest)
                b->seen.shortest = since;
            if (since > b->seen.longest)
                b->seen.longest = since;
        }
        b->last_set = cycle;
    }
}

/* The DAC acts when it is deselected behind a whole frame. */
static void on_dac(struct avr_irq_t *irq, uint32_t value, void *param)
{
    struct board *b = param;
    (void)irq;
    if (value && b->dac_selected) {
        uint8_t command = b->dac_bytes[0] & 0x38, channel = b->dac_bytes[0] & 7;
        if (b->n_dac == 3 && command == 0x18 && channel < 2) {
            note_set(b);
            b->drive(channel, (unsigned)b->dac_bytes[1] << 8 | b->dac_bytes[2], b->avr->cycle);
        } else if (b->n_dac != 3 || command != 0x38) {
            b->seen.bad_frames++;
        }
    }
    b->dac_selected = !value;
    b->n_dac = 0;
}

static void convert(struct board *b, int channel, uint32_t value)
{
    if (value)
        b->sample[channel] = (uint16_t)b->sense(channel, b->avr->cycle);
    else if (b->reads >= 0)
        b->seen.bad_frames++; /* two ADCs drive the same line */
    b->reads = value ? -1 : channel;
    b->n_adc = 0;
}

static void on_adc0(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    convert(param, 0, value);
}

static void on_adc1(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    convert(param, 1, value);
}

static void on_point(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    ((struct board *)param)->seen.points += value;
}

static void on_line(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    ((struct board *)param)->seen.lines += value;
}

static void on_frame(struct avr_irq_t *irq, uint32_t value, void *param)
{
    struct board *b = param;
    (void)irq;
    b->seen.frames += value;
}

static void on_play(struct avr_irq_t *irq, uint32_t value, void *param)
{
    struct board *b = param;
    (void)irq;
    b->plays = (uint8_t)value;
    b->last_set = 0;
}

static void on_sent(struct avr_irq_t *irq, uint32_t value, void *param)
{
    struct board *b = param;
    (void)irq;
    if (b->out_n < RING)
        b->out[b->out_n++] = (uint8_t)value;
}

static void on_xon(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    (void)value;
    ((struct board *)param)->may_send = 1;
}

static void on_xoff(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    (void)value;
    ((struct board *)param)->may_send = 0;
}

/* It tells what it loads, on the standard output of `piezod emulate`. */
static void no_log(avr_t *avr, const int level, const char *format, va_list arguments)
{
    (void)avr;
    (void)level;
    (void)format;
    (void)arguments;
}

/* Its own would wait in real time. */
static void no_sleep(avr_t *avr, avr_cycle_count_t how_long)
{
    (void)avr;
    (void)how_long;
}

static void listen(struct board *b, uint32_t ioctl, int index, avr_irq_notify_t notify)
{
    avr_irq_register_notify(avr_io_getirq(b->avr, ioctl, index), notify, b);
}

static void connect_wires(struct board *b)
{
    uint32_t flags = 0;
    for (const avr_io_t *io = b->avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "uart") && ((const avr_uart_t *)io)->name == '0')
            b->uart = (const avr_uart_t *)io;
    avr_ioctl(b->avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= (uint32_t)~(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(b->avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    listen(b, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT, on_sent);
    listen(b, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON, on_xon);
    listen(b, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF, on_xoff);
    listen(b, AVR_IOCTL_IOPORT_GETIRQ('B'), 3, on_dac);
    listen(b, AVR_IOCTL_IOPORT_GETIRQ('B'), 4, on_adc0);
    listen(b, AVR_IOCTL_IOPORT_GETIRQ('B'), 2, on_adc1);
    listen(b, AVR_IOCTL_IOPORT_GETIRQ('C'), 0, on_point);
    listen(b, AVR_IOCTL_IOPORT_GETIRQ('C'), 1, on_line);
    listen(b, AVR_IOCTL_IOPORT_GETIRQ('C'), 2, on_frame);
    listen(b, AVR_IOCTL_IOPORT_GETIRQ('C'), 3, on_play);
    b->avr->io[AVR_DATA_TO_IO(SPDR)].w.c = spi_write;
    b->avr->io[AVR_DATA_TO_IO(SPDR)].w.param = b;
    b->avr->io[AVR_DATA_TO_IO(SPDR)].r.c = spi_read;
    b->avr->io[AVR_DATA_TO_IO(SPDR)].r.param = b;
}

/* Returns a board with its power on, or NULL. The name is what port_load_name finds; "" for none. */
struct board *board_new(const char *firmware, const char *name, drive_t drive, sense_t sense)
{
    elf_firmware_t elf;
    struct board *b = calloc(1, sizeof *b);
    if (!b)
        return NULL;
    memset(&elf, 0, sizeof elf);
    avr_global_logger_set(no_log);
    b->avr = avr_make_mcu_by_name("atmega1284p");
    if (!b->avr || elf_read_firmware(firmware, &elf)) {
        free(b);
        return NULL;
    }
    b->drive = drive;
    b->sense = sense;
    b->reads = -1;
    b->may_send = 1;
    b->seen.shortest = UINT64_MAX;
    avr_init(b->avr);
    b->avr->log = LOG_NONE;
    b->avr->frequency = CLOCK_HZ;
    b->avr->sleep = no_sleep;
    avr_load_firmware(b->avr, &elf);
    connect_wires(b);
    if (*name) {
        avr_eeprom_desc_t eeprom = {.ee = (uint8_t *)b->name, .offset = 0, .size = 8};
        strncpy(b->name, name, 8);
        avr_ioctl(b->avr, AVR_IOCTL_EEPROM_SET, &eeprom);
    }
    return b;
}

void board_free(struct board *b)
{
    avr_terminate(b->avr);
    free(b);
}

/* The processor starts anew; the converters keep what they have. */
void board_reset(struct board *b)
{
    avr_reset(b->avr);
    b->plays = 0;
}

/* Puts bytes on the line to the board; those beyond its buffer are lost, as on a line without flow control. */
void board_feed(struct board *b, const uint8_t *bytes, unsigned n)
{
    for (unsigned i = 0; i < n && b->in_head - b->in_tail < RING; i++)
        b->in[b->in_head++ % RING] = bytes[i];
}

/* Takes the bytes that the board has sent. */
unsigned board_take(struct board *b, uint8_t *bytes, unsigned most)
{
    unsigned n = b->out_n < most ? b->out_n : most;
    memcpy(bytes, b->out, n);
    memmove(b->out, b->out + n, b->out_n - n);
    b->out_n -= n;
    return n;
}

/* An edge at the trigger input: down and up. */
void board_edge(struct board *b)
{
    avr_irq_t *pin = avr_io_getirq(b->avr, AVR_IOCTL_IOPORT_GETIRQ('D'), 2);
    avr_raise_irq(pin, 0);
    avr_raise_irq(pin, 1);
}

static avr_cycle_count_t on_camera(avr_t *avr, avr_cycle_count_t when, void *param)
{
    struct board *b = param;
    (void)avr;
    board_edge(b);
    return --b->edges_left ? when + b->edge_every : 0;
}

/* A camera at the trigger input: at least one edge, every so many cycles, the first one at a cycle to come. */
void board_camera(struct board *b, uint64_t first, uint64_t every, unsigned edges)
{
    b->edge_every = every;
    b->edges_left = edges;
    avr_cycle_timer_register(b->avr, first - b->avr->cycle, on_camera, b);
}

uint64_t board_cycle(struct board *b)
{
    return b->avr->cycle;
}

int board_plays(struct board *b)
{
    return b->plays;
}

struct seen board_seen(struct board *b)
{
    return b->seen;
}

void board_forget(struct board *b)
{
    memset(&b->seen, 0, sizeof b->seen);
    b->seen.shortest = UINT64_MAX;
    b->last_set = 0;
}

/* Whether the processor has taken all bytes, and has nothing to do. */
static int is_idle(const struct board *b)
{
    return b->in_tail == b->in_head && b->uart->input.read == b->uart->input.write && b->avr->state == cpu_Sleeping &&
           b->avr->cycle >= b->next_byte + QUIET_CYCLES;
}

/* Runs until a cycle; with `until_idle` only until all bytes are taken and the processor sleeps. Returns whether it
 * still runs: it does not after a crash. */
int board_run(struct board *b, uint64_t until, int until_idle)
{
    while (b->avr->cycle < until) {
        if (b->in_tail != b->in_head && b->may_send && b->avr->cycle >= b->next_byte) {
            b->next_byte = b->avr->cycle + BYTE_CYCLES;
            avr_raise_irq(avr_io_getirq(b->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT), b->in[b->in_tail++ % RING]);
        }
        if (until_idle && is_idle(b))
            return 1;
        int state = avr_run(b->avr);
        if (state == cpu_Done || state == cpu_Crashed)
            return 0;
    }
    return 1;
}
