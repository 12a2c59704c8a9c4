"""Load on a daemon: `python -m benchmarks.jitter.load SOCKET WHAT`, until stdin is closed.

`streams`: three clients get telemetry streamed at the highest rate; `streams:N` are N of them.
`requests`: one client asks for the status 40 times a second; the daemon allows a process at most
50. The program prints "ready" at the start, and at the end the actual load as JSON.
"""

import asyncio
import json
import sys
import time
from pathlib import Path

from piezod.client.async_stage_client import AsyncStageClient
from piezod.errors import RefusedError

STREAMS, STREAM_HZ = 3, 50
ASKED_HZ = 40


async def streamed(socket: Path, number: int, counts: dict[str, int]) -> None:
    """Receive a telemetry stream."""
    async with AsyncStageClient(socket=socket, name=f"load-stream-{number}") as stage:
        async for _ in stage.telemetry(rate_hz=STREAM_HZ):
            counts["telemetry"] += 1


async def asking(socket: Path, counts: dict[str, int]) -> None:
    """Request the status at a fixed rate; late requests are left out."""
    async with AsyncStageClient(socket=socket) as stage:
        next_s = time.monotonic()
        while True:
            try:
                await stage.status()
                counts["requests"] += 1
            except RefusedError:
                counts["refused"] += 1
            next_s = max(next_s + 1 / ASKED_HZ, time.monotonic() - 1.0)
            await asyncio.sleep(next_s - time.monotonic())


async def main(socket: Path, what: str) -> None:
    """Generate the load until stdin is closed."""
    counts = {"telemetry": 0, "requests": 0, "refused": 0}
    name, _, number_of = what.partition(":")
    if name == "streams":
        clients = int(number_of or STREAMS)
        burdens = [streamed(socket, number, counts) for number in range(clients)]
    else:
        burdens = [asking(socket, counts)]
    tasks = [asyncio.create_task(burden) for burden in burdens]
    while not any(counts.values()) and not any(task.done() for task in tasks):
        await asyncio.sleep(0.01)
    print("ready", flush=True)
    start_s = time.monotonic()
    counts.update(dict.fromkeys(counts, 0))
    ended = asyncio.create_task(asyncio.to_thread(sys.stdin.read))
    await asyncio.wait([ended, *tasks], return_when=asyncio.FIRST_COMPLETED)
    for task in tasks:
        task.cancel()
    found = await asyncio.gather(*tasks, return_exceptions=True)
    failed = sum(not isinstance(one, asyncio.CancelledError) for one in found)
    seconds = time.monotonic() - start_s
    rates = {f"{name}_hz": count / seconds for name, count in counts.items()}
    print(json.dumps({**rates, "failed": failed}))


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]), sys.argv[2]))
