// Our firmware on an RP2040 by others (rp2040js), with converters as in their data sheets beside it.
// Arguments: the folder that has rp2040js, the image. Each line of the input is a request: {"feed": hex, "run_us": n,
// "edges_us": times from now}; each has an answer: {"sent": hex, ...what was seen}. Time is that of the emulated clock.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { createInterface } from "node:readline";

const { ConsoleLogger, LogLevel, RP2040 } = createRequire(process.argv[2] + "/")("rp2040js");
const CYCLE_NS = 8, BYTE_NS = 20_000, FLASH = 0x10000000;
const [POINT, LINE, FRAME, PLAY, EDGE, DAC, ADC0, ADC1] = [2, 3, 4, 5, 6, 17, 20, 21];

const chip = new RP2040();
chip.logger = new ConsoleLogger(LogLevel.Error, false);
const { clock, core } = chip;
const seen = { out: [null, null], first_ns: null, points: 0, lines: 0, frames: 0, bad: 0, resets: 0, shortest_ns: null, longest_ns: null };
let sent = [], waiting = [], next_byte = 0, edges = [];
let bytes = null, reads = -1, plays = false, last_set = null;
const samples = [0, 0];

function load(file) {
  const image = readFileSync(file);
  for (let at = 0; at < image.length; at += 512) {
    const block = image.subarray(at, at + 512);
    chip.flash.set(block.subarray(32, 32 + block.readUInt32LE(16)), block.readUInt32LE(12) - FLASH);
  }
  core.SP = 0x20042000; // there is no boot ROM: its last step is ours
  core.PC = FLASH;
}

function listen(pin, act) {
  let was = null;
  chip.gpio[pin].addListener((state) => {
    if (state > 1) return; // not driven
    const high = state === 1;
    if (high !== was) act(high);
    was = high;
  });
}

function setOutput([command, high, low]) {
  const channel = command & 7;
  if ((command & 0x38) === 0x38) return;
  if ((command & 0x38) !== 0x18 || channel > 1) return void seen.bad++;
  seen.out[channel] = (high << 8) | low;
  seen.first_ns ??= clock.nanos;
  if (!plays || channel) return;
  if (last_set !== null) {
    const since = clock.nanos - last_set;
    seen.shortest_ns = Math.min(seen.shortest_ns ?? since, since);
    seen.longest_ns = Math.max(seen.longest_ns ?? since, since);
  }
  last_set = clock.nanos;
}

listen(DAC, (high) => {
  if (high && bytes) bytes.length === 3 ? setOutput(bytes) : seen.bad++;
  bytes = high ? null : [];
});
for (const [i, pin] of [ADC0, ADC1].entries())
  listen(pin, (high) => {
    if (high) samples[i] = 1000 + ((seen.out[i] ?? 0) >> 1);
    else if (reads >= 0) seen.bad++; // two drive the same line
    reads = high ? -1 : i;
  });
listen(POINT, (high) => (seen.points += high));
listen(LINE, (high) => (seen.lines += high));
listen(FRAME, (high) => (seen.frames += high));
listen(PLAY, (high) => {
  plays = high;
  last_set = null;
});

const spi = chip.spi[0];
spi.onTransmit = (value) => {
  let reply = 0;
  if (bytes && spi.spiMode === 1 && spi.dataBits === 8) bytes.push(value);
  else if (!bytes && reads >= 0 && spi.spiMode === 0 && spi.dataBits === 16) reply = samples[reads];
  else seen.bad++;
  clock.createAlarm(() => spi.completeTransmit(reply)).schedule((1e9 * spi.dataBits) / spi.clockFrequency);
};
chip.uart[0].onByte = (byte) => sent.push(byte);

function edge() {
  chip.gpio[EDGE].setInputValue(false);
  chip.gpio[EDGE].setInputValue(true);
}

const watchdog = chip.peripherals[0x40058];
watchdog.onWatchdogTrigger = () => {
  seen.resets++;
  watchdog.timer.enable = false; // the reset itself needs the boot ROM
};

function run(until) {
  while (clock.nanos < until) {
    if (waiting.length && clock.nanos >= next_byte) {
      next_byte = clock.nanos + BYTE_NS;
      chip.uart[0].feedByte(waiting.shift());
    }
    while (edges.length && clock.nanos >= edges[0]) {
      edges.shift();
      edge();
    }
    clock.tick(core.executeInstruction() * CYCLE_NS);
  }
}

load(process.argv[3]);
for await (const line of createInterface({ input: process.stdin })) {
  const request = JSON.parse(line);
  waiting.push(...Buffer.from(request.feed ?? "", "hex"));
  edges.push(...(request.edges_us ?? []).map((us) => clock.nanos + us * 1000));
  run(clock.nanos + request.run_us * 1000);
  console.log(JSON.stringify({ sent: Buffer.from(sent).toString("hex"), now_ns: clock.nanos, baud: chip.uart[0].baudRate, ...seen }));
  sent = [];
}
