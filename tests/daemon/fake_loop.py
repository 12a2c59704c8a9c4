"""A loop without devices: it counts healthy cycles and answers requests.

As a process, `start_fake_loop(RUNTIME, CONFIG, COPY, LOCK)`, it accepts the configuration like a
real loop process. If the title of the configuration is "broken", it ends with code 3 when it is
started.
"""

import json
import sys
import threading
import time
from pathlib import Path
from typing import Any, Self

from piezod import __version__
from piezod.config.states import State
from piezod.config.yaml_loader import load_yaml
from piezod.control.stage.answer import Answer
from piezod.daemon import accepted_config
from piezod.errors import ConfigError
from piezod.messages.requests import Estop, Request, Shutdown
from piezod.telemetry.mailbox import MailboxReader
from piezod.telemetry.requests_codec import decode
from piezod.telemetry.shared_map import SharedMap, attach
from piezod.telemetry.words import Word
from tests.forked import Piped


class FakeLoop(threading.Thread):
    """Answers requests until a shutdown, or until the block ends.

    By default it accepts every request, as motion 7.
    """

    def __init__(self, shared: SharedMap, answer: Answer | None = None) -> None:
        super().__init__()
        self.answer = answer or Answer(accepted=True, motion=7)
        self.requests: list[Request] = []
        self._shared = shared
        self._ending = threading.Event()

    def run(self) -> None:
        """Count cycles and answer requests."""
        words, mailbox = self._shared.words, MailboxReader(self._shared)
        words[Word.LOOP_STATE] = list(State).index(State.SAFE)
        words[Word.LOOP_ASKABLE] = 1
        while not self._ending.wait(0.001):
            words[Word.HEALTHY_CYCLES] += 1
            words[Word.LOOP_BEAT_NS] = time.monotonic_ns()
            if number := mailbox.take_estop():
                self.requests.append(Estop())
                mailbox.answer_estop(number, **self.answer._asdict())
            taken = mailbox.take(time.monotonic_ns())
            if taken is not None:
                request = decode(taken[1])
                self.requests.append(request)
                mailbox.answer(taken[0], **self.answer._asdict())
                if isinstance(request, Shutdown):
                    return

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End the thread."""
        self._ending.set()
        self.join()


def start_fake_loop(*arguments: str) -> Any:
    """Start one as a process, as `loop_run` takes it: pipes for bytes."""
    process: Any = Piped(arguments, "tests.daemon.fake_loop")
    process.stdin, process.stdout = process.stdin.detach(), process.stdout.detach()
    return process


def accept(source: Path, copy: Path) -> bool:
    """Accept a configuration like a loop process, without drivers; return whether to run."""
    copy.parent.mkdir(exist_ok=True)
    try:
        document = load_yaml(source).data
        copy.write_text(json.dumps(document), encoding="utf-8")
        accepted_config.parsed(copy.read_text(encoding="utf-8"), copy)
    except ConfigError as error:
        print(json.dumps({"problems": error.problems}), flush=True)
        return False
    answer = {"accepted": document, "named_files": {}, "version": __version__}
    print(json.dumps(answer), flush=True)
    return bool(sys.stdin.readline())


if __name__ == "__main__":
    runtime, source_file, copy_file = map(Path, sys.argv[1:4])
    if accept(source_file, copy_file):
        if json.loads(copy_file.read_text(encoding="utf-8")).get("title") == "broken":
            sys.exit(3)
        FakeLoop(attach(runtime / "loop.map", writable=True)).run()
