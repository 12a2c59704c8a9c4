"""The loop process: `python -m piezod.daemon.loop.process RUNTIME CONFIG COPY LOCK [OPTIONS]`.

`--strict-rt` sets `loop.strict_rt`. `--warm` compiles before the configuration is reported
accepted, so that a loop that takes the place of another one starts soon.

The supervisor starts it. It accepts the configuration and writes the copy (`loop.accept`). Then
the supervisor makes the shared memory and lets it go on. It owns the devices and nothing else: no
HTTP, no log, and no file but the record of a play. It ends on a request, or when the supervisor is
lost, in both cases at the safe voltage: exit code 0. After any other exit code the last voltage is
still in force, and `piezod safe` has to be run.
"""

import signal
import sys
import threading
from collections.abc import Mapping, Sequence
from functools import partial
from math import nan
from os import getpid
from pathlib import Path
from typing import Any, Final

from piezod.config.daemon import DaemonConfig
from piezod.config.faults import Fault
from piezod.control.assembly import assemble
from piezod.control.controller import StageController
from piezod.control.faults.detection import Detection
from piezod.control.warm_up import warm_up
from piezod.daemon.clock import Clock, MonotonicClock
from piezod.daemon.durations import loop_gone_within_s
from piezod.daemon.last_output import LastOutputWriter
from piezod.daemon.loop.absences import Absences
from piezod.daemon.loop.accept import accept
from piezod.daemon.loop.device_counters import DeviceCounters
from piezod.daemon.loop.devices import make_channels
from piezod.daemon.loop.loop import Loop
from piezod.daemon.loop.pacer import Pacer
from piezod.daemon.loop.placement import (
    Placement,
    place,
    raise_thread_priorities,
    rate_refusal,
    start_threads,
)
from piezod.daemon.loop.play_thread import play_threads
from piezod.daemon.loop.processor import ClaimedProcessor
from piezod.daemon.loop.rate import (
    kept_period_ns,
    measure_busy_ns,
    sustained_rate_hz,
    usable_spin_ns,
)
from piezod.daemon.loop.realtime import Realtime, RealtimeStep
from piezod.daemon.loop.start import wait_for_devices, wait_for_lock
from piezod.daemon.loop.timed_channels import TimedChannels
from piezod.daemon.noted_identities import note_identities, noted_identities
from piezod.daemon.output_notes import unconcerned
from piezod.daemon.paths import IDENTITIES, PLAYED
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity, is_same
from piezod.jit import tell_compilations
from piezod.telemetry import requests_codec
from piezod.telemetry.record import StageEvent
from piezod.telemetry.shared_map import SharedMap, attach
from piezod.telemetry.succession import succession_of
from piezod.telemetry.words import HUNG, Word
from piezod.units import NS_PER_S

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ignored here: they end the supervisor, which then asks the loop to shut down."""
STACK_BYTES: Final = 1 << 20
"""Stack of each thread, also of those that drivers start; all of it will be locked in memory."""


def main(
    runtime: Path, source: Path, copy: Path, lock_file: Path, *, strict_rt: bool, warm: bool
) -> None:
    """Run the loop of a stage until a shutdown has ended.

    Args:
        runtime: Folder of the runtime files.
        source: The configuration file.
        copy: Path of the accepted copy.
        lock_file: The lock of the devices.
        strict_rt: Whether to set `loop.strict_rt`, whatever the file says.
        warm: Whether to compile before the configuration is reported accepted.

    Raises:
        PiezodError: If configuration or shared memory cannot be used.
        Exception: Any other failure; the last voltage stays in force.
    """
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    threading.stack_size(STACK_BYTES)
    prepare = _compile if warm else None
    config = accept(source, copy, strict_rt=strict_rt, prepare=prepare)
    if config is None:
        return
    # The supervisor has made the memory before it let this process go on.
    shared = attach(runtime / "loop.map", writable=True)
    shared.words[Word.LOOP_PID] = getpid()
    if not warm:
        _compile(config, shared)
    channels, clock, period_ns = make_channels(config), MonotonicClock(), shared.layout.period_ns
    lock = wait_for_lock(lock_file, shared, clock, loop_gone_within_s(config))
    known = noted_identities(runtime / IDENTITIES)
    if lock is None or not wait_for_devices(channels, shared, clock, known):
        return  # only the end of the process releases the lock
    note_identities(runtime / IDENTITIES, channels.identities)
    placements = place(channels.devices, channels.identities, config.rate_hz, clock)
    plays = play_threads(config, channels, placements, clock, runtime / PLAYED)
    reports = _use_wrappers(channels, placements, shared)
    threads = start_threads(placements)
    last_output = LastOutputWriter(runtime / "output.map", len(config.axes))
    timed, able = TimedChannels(channels, clock, last_output), channels.capabilities()
    forget = partial(_forget, last_output, clock)
    controller = assemble(config, timed, able, forget, plays, channels.levels)
    controller.stay_in_boot(True)
    # With the threads running, because they compete with the cycle for the interpreter.
    busy_ns = measure_busy_ns(controller, clock, period_ns if threads else 0)
    realtime = Realtime(config.loop, shared, 1 + threads)
    # Last: everything is imported, compiled, opened and used once.
    steps = realtime.set_up()
    raise_thread_priorities(placements)
    shared.set_report(_report(steps, placements, realtime.processor))
    _check_arming(controller, config, shared, channels, placements, steps, busy_ns)
    take_over(controller, shared, config, channels, known, last_output.kept_v)
    pacer = _pacer(config, clock, busy_ns, period_ns := kept_period_ns(period_ns, busy_ns))
    loop = Loop(controller, timed, shared, clock, pacer, *reports)
    loop.publisher.events([_rate_event(config, clock.now_ns(), busy_ns, period_ns)])
    loop.publisher.events(_processor_events(realtime.processor, clock.now_ns()))
    _run(loop, realtime, clock)
    # Not after a crash: closing may change the outputs, and `piezod safe` ramps from there.
    channels.close()


def _use_wrappers(
    channels: Channels, placements: Sequence[Placement], shared: SharedMap
) -> tuple[DeviceCounters, Absences]:
    """Use the wrappers of the devices from now on; return what reports about both."""
    used = {one.name: one.device for one in placements}
    counters = DeviceCounters(shared, channels.devices, used)
    channels.use(used)
    return counters, Absences({one.name: one.link for one in placements if one.link is not None})


def _report(
    steps: list[RealtimeStep], placements: Sequence[Placement], processor: ClaimedProcessor | None
) -> dict[str, Any]:
    return {
        "steps": [step._asdict() for step in steps],
        "devices": [one.document() for one in placements],
        "processor": processor and processor.document(),
    }


def _pacer(config: DaemonConfig, clock: Clock, busy_ns: int, period_ns: int) -> Pacer:
    spin_ns = usable_spin_ns(round(config.loop.spin_us * 1000), busy_ns, period_ns)
    return Pacer(clock, period_ns, spin_ns)


def _forget(last_output: LastOutputWriter, clock: Clock) -> None:
    last_output.forget(clock.now_ns())


def _run(loop: Loop, realtime: Realtime, clock: MonotonicClock) -> None:
    """Run the loop to its end; a crash is an event before it is an error."""
    try:
        loop.run()
    except Exception as error:
        text = f"the loop failed: {error!r}; report it, with the log"
        loop.publisher.events([StageEvent(clock.now_ns(), "error", "crash", text)])
        raise
    finally:
        realtime.leave()


def _compile(config: DaemonConfig, shared: SharedMap | None = None) -> None:
    """Compile everything that a cycle uses: during a cycle that would take seconds."""
    if shared is not None:
        tell_compilations(partial(shared.words.__setitem__, Word.COMPILED_KERNELS))
    requests_codec.warm_up()
    warm_up(config)


def _check_arming(
    controller: StageController,
    config: DaemonConfig,
    shared: SharedMap,
    channels: Channels,
    placements: Sequence[Placement],
    steps: list[RealtimeStep],
    busy_ns: int,
) -> None:
    """Forbid arming if a condition for it is not met, with the reason."""
    words, rate_hz = shared.words, sustained_rate_hz(busy_ns)
    words[Word.MEASURED_RATE_HZ] = int(rate_hz)
    missing = [step.name for step in steps if not step.ok]
    limits = [axis.limits for axis in config.axes.values()]
    beyond = channels.beyond_reach([(each.drive_min_v, each.drive_max_v) for each in limits])
    # One reason at a time; a user removes them one by one.
    if beyond:
        controller.forbid_entry(beyond)
    elif slow := rate_refusal(placements, config.rate_hz):
        controller.forbid_entry(slow)
    elif config.rate_hz > rate_hz:
        controller.forbid_entry(f"{_kept_rate(config, rate_hz)}: choose a lower rate")
    elif missing and config.loop.strict_rt:
        controller.forbid_entry(
            f"strict_rt is set and these steps failed: {', '.join(missing)}; see `piezod status`"
        )


def take_over(
    controller: StageController,
    shared: SharedMap,
    config: DaemonConfig,
    channels: Channels,
    known: Mapping[str, Identity],
    noted_v: Sequence[float],
) -> None:
    """Take over what the loop before, the last daemon, or another command has left.

    Args:
        controller: The controller, in BOOT, which it may leave from now on.
        shared: The memory shared with the supervisor.
        config: The configuration of the stage.
        channels: The devices, open.
        known: The identities of the devices that it had opened.
        noted_v: Voltage of each axis that it wrote last, in V; NaN if that is not known.
    """
    if succession := succession_of(shared):
        controller.restore_faults(succession.latched, stopped=succession.stopped)
    gone = unconcerned(config, channels, known, clean=not shared.words[Word.UNCLEAN])
    controller.know_last_writes(
        [nan if name in gone else v for name, v in zip(config.axes, noted_v, strict=True)]
    )
    # The last run did not end in order: an operator must look at the stage first.
    if shared.words[Word.UNCLEAN]:
        controller.report(Detection(Fault.P2))
        if shared.words[Word.UNCLEAN] == HUNG:
            controller.report(Detection(Fault.L3))
        # `piezod safe` has failed if its voltage is still in force, as while a device was absent.
        # Another device may be where it is for a reason.
        if channels.identities.keys() == known.keys() and all(
            is_same(found, known[name]) for name, found in channels.identities.items()
        ):
            controller.ramp_first()
    controller.stay_in_boot(False)


def _rate_event(config: DaemonConfig, t_ns: int, busy_ns: int, period_ns: int) -> StageEvent:
    """Return the event that says which rate this machine keeps."""
    rate_hz = sustained_rate_hz(busy_ns)
    text = f"{_kept_rate(config, rate_hz)}; a cycle takes {busy_ns / 1e3:.0f} µs"
    if config.rate_hz <= rate_hz:
        return StageEvent(t_ns, "info", "rate", text)
    observed = f"the stage is only observed, at {NS_PER_S / period_ns:.0f} Hz: choose a lower rate"
    return StageEvent(t_ns, "warning", "rate", f"{text}; {observed}")


def _processor_events(processor: ClaimedProcessor | None, t_ns: int) -> list[StageEvent]:
    """Return the warning about a processor that other loops have too, if there are any."""
    if processor is None or not processor.shared_with:
        return []
    text = (
        f"processor {processor.cpu} has {processor.shared_with + 1} loops: cycles may be late; run "
        "fewer stages, or allow more processors"
    )
    return [StageEvent(t_ns, "warning", "processor", text)]


def _kept_rate(config: DaemonConfig, rate_hz: float) -> str:
    """Return the configured rate, and the one that the machine keeps, for people."""
    kept = f"this machine with these devices keeps at most {rate_hz:.0f} Hz"
    return f"rate_hz is {config.rate_hz:g}; {kept}"


if __name__ == "__main__":
    paths = [Path(each) for each in sys.argv[1:5]]
    options = sys.argv[5:]
    main(*paths, strict_rt="--strict-rt" in options, warm="--warm" in options)
