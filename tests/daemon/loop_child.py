"""The loop process, with a test instead of its supervisor."""

import os
import threading
import time
from pathlib import Path
from tempfile import TemporaryFile
from typing import Self

from piezod.config.daemon import load_daemon
from piezod.config.states import State
from piezod.devices import registry
from piezod.messages.requests import Request
from piezod.telemetry.events import EventReader
from piezod.telemetry.layout import Layout
from piezod.telemetry.mailbox import MailboxAnswer, MailboxWriter
from piezod.telemetry.record import StageEvent
from piezod.telemetry.requests_codec import encode
from piezod.telemetry.ring import Record, RecordReader
from piezod.telemetry.shared_map import SharedMap, create
from piezod.telemetry.words import Word
from tests.daemon.waiting import eventually
from tests.forked import Forked

BEAT_S = 0.05
STARTED_WITHIN_S = 90.0
"""On a fresh clone, the kernels are compiled first."""


def beat(shared: SharedMap, silent: threading.Event) -> None:
    """Renew the beat of a supervisor until the event is set."""
    while not silent.is_set():
        shared.words[Word.SUPERVISOR_BEAT_NS] = time.monotonic_ns()
        silent.wait(BEAT_S)


class LoopChild:
    """A loop process, and a thread that renews the beat of its supervisor.

    `words` are set before the loop is started.
    """

    def __init__(self, runtime: Path, config: Path, **words: int) -> None:
        self.runtime = runtime
        self.shared = create(runtime / "loop.map", Layout.of(load_daemon(config, registry)))
        for name, value in words.items():
            self.shared.words[Word[name]] = value
        self._events = EventReader(self.shared)
        self._all_events: list[StageEvent] = []
        self._mailbox = MailboxWriter(self.shared)
        self.silent = threading.Event()
        self._beating = threading.Thread(target=beat, args=(self.shared, self.silent))
        self._beating.start()
        copy = runtime / "config" / config.name
        places = (runtime, config, copy, runtime / "loop.lock")
        with TemporaryFile() as word, Path(os.devnull).open("wb") as nothing:
            word.write(b"start\n")
            word.seek(0)
            streams = (word.fileno(), nothing.fileno(), nothing.fileno())
            self.process = Forked(
                [str(each) for each in places], streams, module="piezod.daemon.loop.process"
            )

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process and the thread."""
        self.silent.set()
        self._beating.join()
        self.process.kill()
        self.process.wait()

    @property
    def state(self) -> State:
        """Its state."""
        return list(State)[self.shared.words[Word.LOOP_STATE]]

    @property
    def events(self) -> list[StageEvent]:
        """All events so far."""
        self._all_events += self._events.read()[0]
        return self._all_events

    def latest(self) -> Record:
        """Return the newest record."""
        latest = RecordReader(self.shared).latest()
        assert latest is not None
        return latest

    def wait_for(self, *states: State) -> None:
        """Wait until a living process is in one of these states."""

        def there() -> bool:
            assert self.process.poll() is None, self.events
            return bool(self.shared.words[Word.HEALTHY_CYCLES]) and self.state in states

        eventually(there, STARTED_WITHIN_S)

    def ask(self, request: Request) -> MailboxAnswer:
        """Post a request; return its answer."""
        number = self._mailbox.post(encode(request), time.monotonic_ns() + 10 * 10**9)
        answer = eventually(lambda: self._mailbox.answer(number))
        assert answer is not None
        return answer

    def ended(self) -> int:
        """Wait for its end; return the exit code."""
        return self.process.wait(60.0)
