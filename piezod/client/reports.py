"""Reports, parameters, recordings and the lease, as methods of both clients."""

from piezod.client.calls import Call, ask
from piezod.client.methods import ClientMethod
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

    @ClientMethod
    def status(self) -> Call[Status]:
        """Return state, mode, faults, and each axis in the newest cycle."""
        return ask("status")

    @ClientMethod
    def faults(self) -> Call[Faults]:
        """Return the faults that are present or latched, with their remedies."""
        return ask("faults")

    @ClientMethod
    def health(self) -> Call[Health]:
        """Return whether the loop runs cycles, and the measured values for it."""
        return ask("health")

    @ClientMethod
    def realtime(self) -> Call[Realtime]:
        """Return the real-time settings that the loop requested and obtained."""
        return ask("realtime")

    @ClientMethod
    def metrics(self) -> Call[str]:
        """Return the metrics in the text format of Prometheus."""
        return ask("metrics")

    @ClientMethod
    def config(self) -> Call[Document]:
        """Return the configuration in force."""
        return ask("config")

    @ClientMethod
    def played(self) -> Call[Document]:
        """Return the record of the last play: the voltages as played, and the positions."""
        return ask("played")

    @ClientMethod
    def audit(self) -> Call[Audit]:
        """Return who requested what, newest first."""
        return ask("audit")

    @ClientMethod
    def reload(self) -> Call[Reloaded]:
        """Make the daemon read its configuration again; an invalid one changes nothing.

        The sensor zeros and the learned weights stay. It takes some seconds.
        """
        return ask("reload")

    @ClientMethod
    def params(self) -> Call[Parameters]:
        """Return the parameters in use."""
        return ask("params")

    @ClientMethod
    def params_history(self) -> Call[History]:
        """Return the saved parameters, newest first."""
        return ask("params_history")

    @ClientMethod
    def save_params(self) -> Call[Saved]:
        """Save the parameters in use; the next start of the daemon uses them."""
        return ask("save_params")

    @ClientMethod
    def load_params(self) -> Call[Loaded]:
        """Use the parameters that were saved last; only while disarmed."""
        return ask("load_params")

    @ClientMethod
    def restore_params(self, sequence: int) -> Call[Loaded]:
        """Use parameters that were saved earlier; only while disarmed.

        Args:
            sequence: Their number in the history.
        """
        return ask("restore_params", sequence=sequence)

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
        return ask("start_recording", label=label or None, start_s=start_s)

    @ClientMethod
    def stop_recording(self) -> Call[Recording]:
        """End the recording and close its file."""
        return ask("stop_recording")

    @ClientMethod
    def keep_recording(self, name: str, *, kept: bool = True) -> Call[KeptRecording]:
        """Keep a recording when the daemon removes old ones.

        Args:
            name: Name in `recordings`; the name of a recording stands for all its files.
            kept: False removes the mark.
        """
        return ask("keep_recording", name=name, kept=kept)

    @ClientMethod
    def recordings(self) -> Call[Recordings]:
        """Return the finished recordings, and the one in progress."""
        return ask("recordings")

    @ClientMethod
    def renew_lease(self) -> Call[Lease]:
        """Take or renew the lease for 30 s; each command that needs the lease renews it too."""
        return ask("renew_lease")

    @ClientMethod
    def release_lease(self) -> Call[Released]:
        """Release the lease, so that other clients do not wait for its end."""
        return ask("release_lease")
