"""A stage that runs as a service, and its emulated devices."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from piezod.client import StageClient
from piezod.errors import ClientError
from piezod.messages.answers import Status
from tests.vm.guest.shell import PIEZOD, CheckError, attempt, need, run, shows, wait_until

EXAMPLES: Final = Path("/root/examples")
_CONFIGURATIONS: Final = Path("/etc/piezod")


class Stage:
    """A stage as a service.

    `changes` are patterns in the text of the example, and what replaces them; each must occur.
    """

    def __init__(self, name: str, example: str, changes: Sequence[tuple[str, str]]) -> None:
        self.name, self._example, self._changes = name, example, changes
        self.unit = f"piezod@{name}"

    def configure(self) -> None:
        """Write its configuration."""
        if not EXAMPLES.exists():
            run(f"{PIEZOD} init {EXAMPLES} && cp -r {EXAMPLES}/models /etc/piezod/")
        text = (EXAMPLES / self._example).read_text("utf-8")
        for pattern, new in (*self._changes, (r"\.\./models/", "models/")):
            text = re.sub(pattern, new, text)
        (_CONFIGURATIONS / f"{self.name}.yaml").write_text(text, "utf-8")

    def start(self) -> None:
        """Start the service, and wait until it is ready.

        Raises:
            CheckError: If it does not start; the reason has the end of its log.
        """
        attempt(f"systemctl reset-failed {self.unit}")
        if attempt(f"systemctl start {self.unit}").returncode:
            raise CheckError(f"{self.unit} does not start: {self.log()[-2000:]}")

    def stop(self) -> None:
        """Stop the service."""
        run(f"systemctl stop {self.unit}")

    def log(self) -> str:
        """Return its journal."""
        return run(f"journalctl --boot --no-pager --output=cat --unit={self.unit}")

    @property
    def supervisor(self) -> int:
        """Process of the service.

        Raises:
            CheckError: If there is none. Its number would be 0, and a signal to 0 hits the caller.
        """
        pid = int(shows(self.unit, "MainPID"))
        need(pid, f"{self.unit} has no process")
        return pid

    @property
    def loop(self) -> int:
        """Process of its loop."""
        return int(run(f"pgrep --parent {self.supervisor} --full loop.process"))

    def client(self) -> StageClient:
        """Return a client of root, who is an engineer."""
        return StageClient(socket=Path("/run/piezod", self.name, "api.sock"), name="vm")

    def status(self) -> Status:
        """Return the status of the stage."""
        with self.client() as client:
            return client.status()

    def faults(self) -> set[str]:
        """Return the ids of the faults that are present or latched."""
        return {fault.id for fault in self.status().faults}

    def wait_for(self, state: str, within_s: float = 120.0) -> Status:
        """Wait for a state; return the status in it."""
        seen: list[Status] = []

        def reached() -> bool:
            try:
                seen[:] = [self.status()]
            except ClientError:  # it starts just now
                return False
            return seen[0].state == state

        try:
            wait_until(reached, f"{self.name} in state {state}", within_s)
        except CheckError as error:
            last = [f"{each.state} {[fault.id for fault in each.faults]}" for each in seen]
            raise CheckError(f"{error}; last {last}; log: {self.log()[-1500:]}") from error
        return seen[0]

    def runs_on(self, loop: int, status: Status) -> None:
        """Check that the stage ran on at this status, and still runs in the same loop.

        On an emulated processor a tenth of the cycles may be late (L2): the stage holds meanwhile.
        """
        state, faults = status.state, {fault.id for fault in status.faults}
        need(state == "RUN" or (state == "HOLD" and "L2" in faults), f"{state} with {faults}")
        self.wait_for("RUN")
        need(self.loop == loop, "the loop was started again")

    def reset(self) -> None:
        """Reset the stage, as a person does, until it is at rest without a fault."""

        def done() -> bool:
            with self.client() as client:
                try:
                    client.reset()
                except ClientError:  # not yet: a device is still absent, or the stage still ramps
                    return False
                status = client.status()
            return status.state == "SAFE" and not any(fault.latched for fault in status.faults)

        try:
            wait_until(done, "SAFE without a latched fault")
        except CheckError as error:
            raise CheckError(f"{self.name}: {error}; log: {self.log()[-1500:]}") from error

    def arm(self) -> None:
        """Arm the stage, as soon as it lets itself be armed: late cycles may forbid it a while."""

        def armed() -> bool:
            try:
                with self.client() as client:
                    if client.status().state == "FAULT":
                        client.reset()
                    client.arm()
            except ClientError:
                return False
            return True

        try:
            wait_until(armed, "the stage lets itself be armed", 180.0)
        except CheckError as error:
            raise CheckError(f"{error}; log: {self.log()[-1500:]}") from error
        self.wait_for("READY", 300.0)

    def move(self, position_um: float) -> Status:
        """Arm the stage, move it, and wait until it has arrived."""
        self.arm()
        with self.client() as client:
            client.goto_and_wait(position_um, timeout_s=60.0)
            return client.status()
