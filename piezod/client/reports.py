"""Reports, parameters, recordings and the lease, as methods of both clients."""

from piezod.client.calls import Call, ask
from piezod.client.methods import ClientMethod, PlainMethod
from piezod.messages.answers import Faults, Health, Lease, Realtime, Released, Status
from piezod.messages.documents import Document
from piezod.messages.stores import (
    Audit,
    History,
    KeptRecording,
    Loaded,
    Parameters,
    Recording,
    Recordings,
    Reloaded,
    Saved,
)


class StageReports:
    """Methods that the daemon answers without a request to the loop."""

    status = PlainMethod(Status, "Return state, mode, faults, and each axis in the newest cycle.")
    faults = PlainMethod(
        Faults, "Return the faults that are present or latched, with their remedies."
    )
    health = PlainMethod(
        Health, "Return whether the loop runs cycles, and the measured values for it."
    )
    realtime = PlainMethod(
        Realtime, "Return the real-time settings that the loop requested and obtained."
    )
    metrics = PlainMethod(str, "Return the metrics in the text format of Prometheus.")
    config = PlainMethod(Document, "Return the configuration in force.")
    played = PlainMethod(
        Document, "Return the record of the last play: the voltages as played, and the positions."
    )

    @ClientMethod
    def scanned(self, first: int = 0) -> Call[Document]:
        """Return the last scan: its state, and the samples of some sweeps.

        Args:
            first: Index of the first of these sweeps.
        """
        return ask("scanned", first=first)

    audit = PlainMethod(Audit, "Return who requested what, newest first.")
    reload = PlainMethod(
        Reloaded,
        "Make the daemon read its configuration again; an invalid one changes nothing.\n\n"
        "The sensor zeros and the learned weights stay. It takes some seconds.",
    )
    params = PlainMethod(Parameters, "Return the parameters in use.")
    params_history = PlainMethod(History, "Return the saved parameters, newest first.")
    save_params = PlainMethod(
        Saved, "Save the parameters in use; the next start of the daemon uses them."
    )
    load_params = PlainMethod(
        Loaded, "Use the parameters that were saved last; only while disarmed."
    )

    @ClientMethod
    def restore_params(self, sequence: int) -> Call[Loaded]:
        """Use parameters that were saved earlier; only while disarmed.

        Args:
            sequence: Their number in the history.
        """
        return ask("restore_params", sequence=sequence)

    @ClientMethod
    def start_recording(
        self,
        label: str | None = None,
        *,
        start_s: float | None = None,
        line: str | None = None,
        before_s: float = 0.0,
        duration_s: float | None = None,
    ) -> Call[Recording]:
        """Start recording every cycle, at once or at the rising edge of a line.

        Args:
            label: Becomes part of the name, which the daemon makes.
            start_s: Instant of the first cycle that is recorded, and of time 0 in the file, as in
                `wave`; None for the next cycle.
            line: Line of the stage whose rising edge starts it, and is time 0; None for none.
            before_s: Time before the edge that is recorded, too, in s, at most 10.
            duration_s: Time from the edge to the end, in s; None for the falling edge.
        """
        edge = None
        if line is not None:
            edge = {"line": line, "before_s": before_s, "duration_s": duration_s}
        return ask("start_recording", label=label or None, start_s=start_s, edge=edge)

    stop_recording = PlainMethod(Recording, "End the recording and close its file.")

    @ClientMethod
    def keep_recording(self, name: str, *, kept: bool = True) -> Call[KeptRecording]:
        """Keep a recording when the daemon removes old ones.

        Args:
            name: Name in `recordings`; the name of a recording stands for all its files.
            kept: False removes the mark.
        """
        return ask("keep_recording", name=name, kept=kept)

    recordings = PlainMethod(Recordings, "Return the finished recordings, and the one in progress.")
    renew_lease = PlainMethod(
        Lease, "Take or renew the lease for 30 s; each command that needs the lease renews it too."
    )
    release_lease = PlainMethod(
        Released, "Release the lease, so that other clients do not wait for its end."
    )
