"""Reports, parameters, recordings and the lease, as methods of both clients."""

from typing import Final

from piezod.client.calls import Call
from piezod.client.methods import ClientMethod
from piezod.client.reader import reader
from piezod.messages.answers import (
    Document,
    Faults,
    Health,
    History,
    KeptRecording,
    Parameters,
    Recording,
    Recordings,
    Reloaded,
    Saved,
    Status,
)
from piezod.messages.endpoints import ENDPOINTS

RELOADED_WITHIN_S: Final = 150.0
"""A reload compiles and starts a loop process, and starts the old one again if that fails, in s."""


class StageReports:
    """Methods that the daemon answers without a request to the loop."""

    @ClientMethod
    def status(self) -> Call[Status]:
        """Return state, mode, faults, and each axis in the newest cycle."""
        return Call(ENDPOINTS["status"], reader(Status))

    @ClientMethod
    def faults(self) -> Call[Faults]:
        """Return the faults that are present or latched, with their remedies."""
        return Call(ENDPOINTS["faults"], reader(Faults))

    @ClientMethod
    def health(self) -> Call[Health]:
        """Return whether the loop runs cycles, and the measured values for it."""
        return Call(ENDPOINTS["health"], reader(Health), also_fine=503)

    @ClientMethod
    def realtime(self) -> Call[Document]:
        """Return the real-time settings that the loop requested and obtained."""
        return Call(ENDPOINTS["realtime"], _unchanged)

    @ClientMethod
    def metrics(self) -> Call[str]:
        """Return the metrics in the text format of Prometheus."""
        return Call(ENDPOINTS["metrics"], _text, plain_text=True)

    @ClientMethod
    def config(self) -> Call[Document]:
        """Return the configuration in force."""
        return Call(ENDPOINTS["config"], _unchanged)

    @ClientMethod
    def played(self) -> Call[Document]:
        """Return the record of the last play: the voltages as played, and the positions."""
        return Call(ENDPOINTS["played"], _unchanged)

    @ClientMethod
    def audit(self) -> Call[Document]:
        """Return who requested what, newest first."""
        return Call(ENDPOINTS["audit"], _unchanged)

    @ClientMethod
    def reload(self) -> Call[Reloaded]:
        """Make the daemon read its configuration again; an invalid one changes nothing.

        The sensor zeros and the learned weights stay. It takes some seconds.
        """
        return Call(ENDPOINTS["reload"], reader(Reloaded), {}, answer_within_s=RELOADED_WITHIN_S)

    @ClientMethod
    def params(self) -> Call[Parameters]:
        """Return the parameters in use."""
        return Call(ENDPOINTS["params"], reader(Parameters))

    @ClientMethod
    def params_history(self) -> Call[History]:
        """Return the saved parameters, newest first."""
        return Call(ENDPOINTS["params_history"], reader(History))

    @ClientMethod
    def save_params(self) -> Call[Saved]:
        """Save the parameters in use; the next start of the daemon uses them."""
        return Call(ENDPOINTS["save_params"], reader(Saved), {})

    @ClientMethod
    def load_params(self) -> Call[Saved]:
        """Use the parameters that were saved last; only while disarmed."""
        return Call(ENDPOINTS["load_params"], reader(Saved), {})

    @ClientMethod
    def restore_params(self, sequence: int) -> Call[Saved]:
        """Use parameters that were saved earlier; only while disarmed.

        Args:
            sequence: Their number in the history.
        """
        return Call(ENDPOINTS["restore_params"], reader(Saved), {"sequence": sequence})

    @ClientMethod
    def start_recording(
        self, label: str | None = None, *, start_s: float | None = None
    ) -> Call[Recording]:
        """Start recording every cycle.

        Args:
            label: Becomes part of the name, which the daemon makes.
            start_s: Instant of the first cycle that is recorded, and of time 0 in the file, as in
                `wave`; None for the next cycle.
        """
        body: Document = {"label": label} if label else {}
        if start_s is not None:
            body["start_s"] = start_s
        return Call(ENDPOINTS["start_recording"], reader(Recording), body)

    @ClientMethod
    def stop_recording(self) -> Call[Recording]:
        """End the recording and close its file."""
        return Call(ENDPOINTS["stop_recording"], reader(Recording), {})

    @ClientMethod
    def keep_recording(self, name: str, *, kept: bool = True) -> Call[KeptRecording]:
        """Keep a recording when the daemon removes old ones.

        Args:
            name: Name in `recordings`; the name of a recording stands for all its files.
            kept: False removes the mark.
        """
        body = {"name": name, "kept": kept}
        return Call(ENDPOINTS["keep_recording"], reader(KeptRecording), body)

    @ClientMethod
    def recordings(self) -> Call[Recordings]:
        """Return the finished recordings, and the one in progress."""
        return Call(ENDPOINTS["recordings"], reader(Recordings))

    @ClientMethod
    def renew_lease(self) -> Call[Document]:
        """Take or renew the lease for 30 s; each command that needs the lease renews it too."""
        return Call(ENDPOINTS["renew_lease"], _unchanged, {})

    @ClientMethod
    def release_lease(self) -> Call[Document]:
        """Release the lease, so that other clients do not wait for its end."""
        return Call(ENDPOINTS["release_lease"], _unchanged)


def _text(document: Document) -> str:
    text: str = document["text"]
    return text


def _unchanged(document: Document) -> Document:
    return document
