"""Brings a stage that drives a voltage down, as a person does."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final

from piezod.client import AsyncStageClient
from piezod.config.states import State
from piezod.errors import RefusedError
from piezod.units import s_to_ns
from tests.soak.machine import Machine

REACHES_S: Final = 60.0
"""Once a fault of the output is over, the stage reaches its safe voltage in this time, in s."""


async def bring_down(
    machine: Machine,
    stage: AsyncStageClient,
    stop: Callable[[], Awaitable[None]],
    refused: Callable[[RefusedError], None],
) -> None:
    """Stop, and go on by the steps of docs/faults.md until the output is at its safe voltage.

    Args:
        machine: The machine.
        stage: Its stage.
        stop: Stops the stage, in an emergency or not.
        refused: Takes each refusal.

    Raises:
        RuntimeError: If that takes too long.
    """
    clock, rig = machine.clock, machine.rig
    end_ns = clock.t_ns + s_to_ns(REACHES_S)
    await stop()
    await asyncio.sleep(1.0)
    while rig.is_driven(clock.t_ns):
        state = (await stage.status()).state
        if clock.t_ns > end_ns:
            output_v = rig.output.output_v(clock.t_ns)
            raise RuntimeError(f"nobody can bring {output_v:.1f} V down in {state}")
        try:
            match state:
                case State.SAFE:
                    await stage.arm()
                case State.FAULT | State.ESTOP:
                    await stage.reset(engineer=True)
                case State.READY | State.RUN | State.IDENT | State.HOLD:
                    await stop()
        except RefusedError as error:
            refused(error)
        await asyncio.sleep(1.0)
