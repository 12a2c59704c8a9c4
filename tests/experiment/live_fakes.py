"""A fake of a running stage, with its states and its own time."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from piezod.client import StageClient
from piezod.client.calls import Call
from piezod.client.place import Place
from piezod.config.daemon import load_daemon
from piezod.config.model_file import load_model
from piezod.daemon import accepted_config
from piezod.devices import registry
from piezod.errors import RefusedError
from piezod.messages.telemetry import AxisTelemetry, Range, Telemetry

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "config" / "simulated.yaml"
MODEL = ROOT / "config" / "models" / "simulated-stack.yaml"
INTERVAL_S = 0.05
LEAD_IN_S = 0.1
"""Time of the movement to the start of a waveform, in s."""

ResultT = TypeVar("ResultT")
Document = dict[str, Any]


def stage_document(**axis: object) -> Document:
    """Return the configuration of a stage as its daemon reports it, with other keys of axis x."""
    config = load_daemon(CONFIG, registry).model_copy(update={"rate_hz": 1000.0})
    document = accepted_config.document(config)
    document["axes"]["x"] |= axis
    return document


class FakeStage(StageClient):
    """Executes every request at once, and records it.

    `each` is called before each interval of telemetry, so that a test can cause a failure.

    Args:
        document: Configuration of the stage.
    """

    def __init__(self, document: Document | None = None) -> None:
        self.place, self.name = Place(Path("/nowhere/fake/api.sock")), "test"
        self.document = document or stage_document()
        self.model: Document | None = load_model(MODEL).model_dump(mode="json")
        self.state, self.mode_now, self.motion = "SAFE", "feedforward", 0
        self.t_s, self.ends_s = 100.0, 0.0
        self.present: tuple[str, ...] = ()
        self.skipped = 0
        self.asked: list[str] = []
        self.bodies: list[Document | None] = []
        self.refused: dict[str, str] = {}
        self.each: Callable[[FakeStage], None] = lambda _stage: None
        self.why = ""
        """Reason why a recording ends by itself."""

    def call(self, call: Call[ResultT]) -> ResultT:
        """Execute a call, or refuse it as in `refused`."""
        what = call.path if call.method == "POST" else f"{call.method} {call.path}"
        self.asked.append(what)
        self.bodies.append(call.body)
        if what in self.refused:
            raise RefusedError(self.refused[what], "a remedy", "state")
        return call.read(self._answer(call.path, call.body or {}))

    @contextmanager
    def session(self) -> Generator[None, None, None]:
        """Record begin and end of the session."""
        self.asked.append("session")
        self.bodies.append({})
        if "session" in self.refused:
            raise RefusedError(self.refused["session"], "a remedy", "lease_held")
        try:
            yield
        finally:
            self.asked.append("end of the session")
            self.bodies.append(None)

    def telemetry(
        self, rate_hz: float = 10.0, axes: Sequence[str] = ()
    ) -> Generator[Telemetry, None, None]:
        """Yield intervals for ever."""
        assert (rate_hz, axes) == (20.0, ())
        while True:
            self.t_s += INTERVAL_S
            if self.state == "IDENT" and self.t_s > self.ends_s:
                self.state = "READY"
            self.each(self)
            yield self._interval()

    def _answer(self, path: str, body: Mapping[str, Any]) -> Document:
        answers: Mapping[str, Document] = {
            "config": self.document,
            "params": {"axes": {"x": {"model": self.model}}, "sequence": None},
            "status": {
                "stage": "fake",
                "state": self.state,
                "mode": self.mode_now,
                "faults": [],
                "skipped_cycles": 0,
                "axes": {},
            },
            "recordings/start": {"name": "recording"},
            "recordings/stop": {"name": "recording", "why": self.why},
        }
        if path in answers:
            return answers[path]
        self._do(path, body)
        return {"motion": self.motion, "duration_s": body.get("duration_s", 0.0) + LEAD_IN_S}

    def _do(self, path: str, body: Mapping[str, Any]) -> None:
        after = {"stop": "SAFE", "arm": "READY", "wave": "RUN", "identify": "IDENT"}
        if path != "arm" or self.state == "SAFE":
            self.state = after.get(path, self.state)
        if path == "mode":
            self.mode_now = body["mode"]
            self.state = "RUN" if self.state == "READY" else self.state
        if path == "wave":
            self.motion += 1
        if path == "identify":
            self.ends_s = self.t_s + body["duration_s"]

    def _interval(self) -> Telemetry:
        zero = Range(min=0.0, max=0.0, last=0.0)
        axis = AxisTelemetry(
            position_um=zero,
            command_um=zero,
            drive_v=zero,
            error_um=zero,
            mode=self.mode_now,
            motion=self.motion,
        )
        return Telemetry(
            t_s=self.t_s,
            cycles=50,
            lost=0,
            state=self.state,
            faults=self.present,
            skipped_cycles=self.skipped,
            axes={"x": axis},
        )
