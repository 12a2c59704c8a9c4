/* SPDX-License-Identifier: MIT */
#include "commands.h"

#include "line.h"
#include "play.h"
#include "player.h"
#include "reply.h"
#include "text.h"

#define CH PORT_CHANNELS
#define MOST_ROWS 128 /* of data that are sent or received at a time */

static const char RANGE[] = "range", SYNTAX[] = "syntax", BUSY[] = "busy", OFF[] = "off", MEMORY[] = "memory";

static struct {
    uint16_t at, rows; /* rows of the record that are to be sent */
} asked;

static void say(const char *name, uint32_t number)
{
    reply_char(' ');
    reply_text(name);
    reply_char('=');
    reply_plain(number);
}

static const char *identify(const char *at)
{
    char name[PORT_NAME_SIZE + 1];
    if (!text_ends(at))
        return SYNTAX;
    port_load_name(name);
    reply_text("I piezod-player board=" PORT_NAME " firmware=" PLAYER_VERSION " name=");
    reply_text(name[0] ? name : "-");
    say("protocol", PLAYER_PROTOCOL);
    say("channels", CH);
    say("memory", PORT_MEMORY_ROWS);
    say("clock", PORT_CLOCK_HZ);
    say("shortest", PORT_SHORTEST);
    say("longest", PORT_LONGEST);
    say("lowest", PLAYER_LOWEST);
    say("highest", PLAYER_HIGHEST);
    say("safe", PLAYER_SAFE);
    say("edges", 1);
    return 0;
}

static void say_flags(void)
{
    uint8_t flags = player_flags();
    reply_char(' ');
    if (!flags)
        reply_char('-');
    for (uint8_t i = 0; i < 4; i++)
        if (flags & 1u << i)
            reply_char("rwlo"[i]);
}

static void say_status(void)
{
    static const char *const states[] = {"S off", "S on", "S play"};
    uint16_t out[CH], in[CH];
    enum player_state state = player_state();
    struct play_progress progress = play_progress(); /* after the state: where this is "on", a play is complete */
    player_read(out, in);
    reply_text(states[state]);
    say_flags();
    for (uint8_t i = 0; i < CH; i++)
        reply_number(out[i]);
    for (uint8_t i = 0; i < CH; i++)
        reply_number(in[i]);
    reply_number(progress.cycle);
    reply_number(progress.kept);
}

static const char *status(const char *at)
{
    if (!text_ends(at))
        return SYNTAX;
    say_status();
    return 0;
}

static const char *turn_on(const char *at)
{
    if (!text_ends(at))
        return SYNTAX;
    if (player_state() == PLAYER_PLAYING)
        return BUSY;
    player_on();
    say_status();
    return 0;
}

static const char *turn_off(const char *at)
{
    if (!text_ends(at))
        return SYNTAX;
    player_off();
    say_status();
    return 0;
}

static const char *set(const char *at)
{
    uint16_t wanted[CH];
    bool fits = true;
    for (uint8_t i = 0; i < CH; i++) {
        uint32_t count;
        if (!text_number(&at, UINT32_MAX, &count))
            return SYNTAX;
        fits = fits && count <= 65535;
        wanted[i] = (uint16_t)count;
    }
    if (!text_ends(at))
        return SYNTAX;
    if (player_state() != PLAYER_ON)
        return player_state() == PLAYER_OFF ? OFF : BUSY;
    if (!fits || !player_set(wanted))
        return RANGE;
    say_status();
    return 0;
}

static const char *watch(const char *at)
{
    uint16_t ms;
    if (!text_count(&at, &ms) || !text_ends(at))
        return SYNTAX;
    player_set_watchdog(ms);
    say_status();
    return 0;
}

/* Reads first row and number of rows of a part of a memory. */
static const char *part(const char *at, uint16_t memory, uint16_t *first, uint16_t *rows)
{
    if (!text_count(&at, first) || !text_count(&at, rows) || !text_ends(at))
        return SYNTAX;
    if (!*rows || *rows > MOST_ROWS || *first > memory || *rows > memory - *first)
        return MEMORY;
    return 0;
}

static const char *write_table(const char *at)
{
    uint16_t first, rows;
    const char *error = part(at, PORT_MEMORY_ROWS, &first, &rows);
    if (error)
        return error;
    if (player_state() == PLAYER_PLAYING)
        return BUSY;
    line_expect((uint16_t)(first * CH * 2), (uint16_t)(rows * CH * 2));
    reply_text("T go");
    return 0;
}

static const char *read_record(const char *at)
{
    uint16_t first, rows;
    const char *error = part(at, play_progress().kept, &first, &rows);
    if (error)
        return error;
    if (player_state() == PLAYER_PLAYING)
        return BUSY;
    asked.at = first;
    asked.rows = rows;
    reply_char('R');
    reply_number(first);
    reply_number(rows);
    return 0;
}

static const char *prepare(const char *at)
{
    struct play_plan plan;
    uint16_t crc;
    if (!text_count(&at, &plan.lead) || !text_count(&at, &plan.period) ||
        !text_number(&at, UINT32_MAX, &plan.cycles) || !text_number(&at, UINT32_MAX, &plan.interval) ||
        !text_number(&at, UINT32_MAX, &plan.first) || *at != ' ' || !text_hex(at + 1, &crc))
        return SYNTAX;
    if (player_state() == PLAYER_PLAYING)
        return BUSY;
    if (plan.interval < PORT_SHORTEST || plan.interval > PORT_LONGEST || !plan.cycles)
        return RANGE;
    if (!plan.period || plan.lead > PORT_MEMORY_ROWS || plan.period > PORT_MEMORY_ROWS - plan.lead ||
        play_edge_rows() > PORT_MEMORY_ROWS - plan.lead - plan.period)
        return MEMORY;
    if (play_crc(plan.lead + plan.period) != crc)
        return "table";
    if (play_outside(plan.lead + plan.period) < plan.lead + plan.period)
        return RANGE;
    play_prepare(&plan);
    say_status();
    return 0;
}

static const char *set_lines(const char *at)
{
    struct play_lines lines = {.active = PLAY_WHOLE, .frame = PLAY_WHOLE};
    if (!text_count(&at, &lines.point) || !text_count(&at, &lines.line))
        return SYNTAX;
    lines.length = lines.line;
    if (!text_ends(at) && (!text_count(&at, &lines.length) || !text_count(&at, &lines.active) ||
                           !text_count(&at, &lines.skip) || !text_count(&at, &lines.frame) || !text_ends(at)))
        return SYNTAX;
    if (player_state() == PLAYER_PLAYING)
        return BUSY;
    play_set_lines(&lines);
    say_status();
    return 0;
}

static const char *set_waits(const char *at)
{
    struct play_waits waits;
    if (!text_count(&at, &waits.first) || !text_count(&at, &waits.every) || !text_count(&at, &waits.count) ||
        !text_ends(at))
        return SYNTAX;
    if (player_state() == PLAYER_PLAYING)
        return BUSY;
    if (!waits.every)
        return RANGE;
    if (waits.count > PORT_MEMORY_ROWS / 2)
        return MEMORY;
    play_set_waits(&waits);
    say_status();
    return 0;
}

static const char *tell_edge(const char *at)
{
    struct play_edges edges = play_edges();
    uint16_t wanted;
    bool used, one = !text_ends(at);
    if (one && (!text_count(&at, &wanted) || !text_ends(at)))
        return SYNTAX;
    if (one && wanted >= edges.stored)
        return MEMORY;
    reply_char('K');
    if (one) {
        reply_number(play_edge(wanted, &used));
        reply_number(used);
    } else {
        reply_number(edges.seen);
        reply_number(edges.stored);
        reply_number(edges.waiting);
    }
    return 0;
}

static const char *go(const char *at)
{
    enum clock clock = CLOCK_NOW;
    if (text_word(&at, "start"))
        clock = CLOCK_START_ON_EDGE;
    else if (text_word(&at, "step"))
        clock = CLOCK_STEP_ON_EDGE;
    if (!text_ends(at))
        return SYNTAX;
    if (player_state() != PLAYER_ON)
        return player_state() == PLAYER_OFF ? OFF : BUSY;
    if (!play_is_prepared())
        return "table";
    if (clock == CLOCK_STEP_ON_EDGE && play_edge_rows())
        return RANGE; /* each point waits already */
    player_go(clock);
    say_status();
    return 0;
}

static const char *hold(const char *at)
{
    if (!text_ends(at))
        return SYNTAX;
    player_hold();
    say_status();
    return 0;
}

static const char *store_name(const char *at)
{
    char name[PORT_NAME_SIZE + 1];
    uint8_t n = 0;
    if (*at++ != ' ')
        return SYNTAX;
    for (; *at && n < PORT_NAME_SIZE; at++) {
        if (*at <= ' ' || *at > '~' || *at == '*')
            return SYNTAX;
        name[n++] = *at;
    }
    name[n] = 0;
    if (!n || !text_ends(at))
        return SYNTAX;
    if (player_state() != PLAYER_OFF)
        return BUSY; /* writing takes milliseconds */
    port_store_name(name);
    say_status();
    return 0;
}

const char *command_run(const char *request)
{
    static const struct {
        const char *word;
        const char *(*run)(const char *at);
    } commands[] = {
        {"V", set}, {"?", status}, {"I", identify}, {"ON", turn_on}, {"OFF", turn_off}, {"W", watch},
        {"T", write_table}, {"P", prepare}, {"L", set_lines}, {"G", go}, {"A", hold}, {"R", read_record},
        {"N", store_name}, {"E", set_waits}, {"K", tell_edge},
    };
    asked.rows = 0;
    for (uint8_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
        const char *at = request;
        if (*request != ' ' && text_word(&at, commands[i].word))
            return commands[i].run(at);
    }
    return "unknown";
}

void command_send_data(void)
{
    if (!asked.rows)
        return;
    reply_begin();
    for (uint16_t i = 0; i < asked.rows * CH; i++)
        reply_value(play_recorded((uint16_t)(asked.at * CH + i)));
    reply_data_end();
}
