"""What the page costs: processor time and memory of the supervisor and of `piezod web`.

`python benchmarks/bench_page.py` starts the simulated stage at 1 kHz and a server of the page, and
prints the parts of a core that both take without a tab, with tabs at 30 Hz, and after the tabs. One
part is the supervisor, the other the server.
"""

import asyncio
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import AsyncExitStack, ExitStack
from pathlib import Path
from typing import Final, TextIO
from urllib.parse import urlsplit

import httpcore
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Origin

from piezod.client import running_stages

STAGE: Final = "page"
RATE_HZ: Final = 1000
TABS: Final = 3
MEASURED_S: Final = 20.0
ROUNDS: Final = 3
"""Rounds with tabs; memory that grows from round to round is never given back."""
CONFIG: Final = Path(__file__).parents[1] / "config"
PIEZOD: Final = (sys.executable, "-m", "piezod")
UP_WITHIN_S: Final = 120.0


def cpu_s(pid: int) -> float:
    """Return the processor time of a process, in s."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mb(pid: int) -> float:
    """Return the memory of a process in RAM, in MB."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    found = re.search(r"VmRSS:\s+(\d+)", status)
    return int(found[1]) / 1024 if found else 0.0


async def measured(title: str, pids: dict[str, int], events: list[int]) -> None:
    """Wait, then print what the processes have taken."""
    before, seen = {name: cpu_s(pid) for name, pid in pids.items()}, sum(events)
    begun_s = time.monotonic()
    await asyncio.sleep(MEASURED_S)
    passed_s = time.monotonic() - begun_s
    parts = {name: (cpu_s(pid) - before[name]) / passed_s for name, pid in pids.items()}
    cost = ", ".join(f"{name} {part:5.1%}" for name, part in parts.items())
    memory = ", ".join(f"{resident_mb(pid):.0f} MB" for pid in pids.values())
    rate_hz = (sum(events) - seen) / passed_s
    print(
        f"{title:18} {cost}, sum {sum(parts.values()):5.1%} of a core; {memory}; "
        f"{rate_hz:.0f} events/s"
    )


async def read(socket: ClientConnection, events: list[int]) -> None:
    """Count the rows that a tab gets."""
    async for text in socket:
        message = json.loads(text)
        if message.get("event") == "telemetry":
            events[0] += len(message["t_s"])


async def opened_tabs(
    url: str, stack: AsyncExitStack, stages: Sequence[str] = (STAGE,) * TABS
) -> list[ClientConnection]:
    """Open a tab for each stage of a list, which watches it; they are closed with the stack."""
    address = urlsplit(url)
    async with httpcore.AsyncConnectionPool() as http:
        answer = await http.request("GET", url)
    cookie = dict(answer.headers)[b"set-cookie"].partition(b";")[0].decode()
    tabs = []
    for stage in stages:
        socket = await stack.enter_async_context(
            connect(
                f"ws://{address.netloc}/ws",
                origin=Origin(f"http://{address.netloc}"),
                additional_headers={"Cookie": cookie},
                compression=None,
            )
        )
        await socket.send(json.dumps({"id": 1, "do": "watch", "stage": stage}))
        tabs.append(socket)
    return tabs


async def use(url: str, pids: dict[str, int]) -> None:
    """Measure without tabs, with tabs, and after them."""
    events = [0]
    await measured("no tab", pids, events)
    for number in range(ROUNDS):
        async with AsyncExitStack() as stack:
            tabs = await opened_tabs(url, stack)
            readers = [asyncio.create_task(read(socket, events)) for socket in tabs]
            await asyncio.sleep(2.0)
            await measured(f"{TABS} tabs, round {number + 1}", pids, events)
            for reader in readers:
                reader.cancel()
    await measured("after the tabs", pids, events)


def wait_until_up(environ: dict[str, str], page: Path) -> None:
    """Wait until the stage answers and the address of the page is known."""
    end_s = time.monotonic() + UP_WITHIN_S
    while not running_stages(environ) or not page.stat().st_size:
        if time.monotonic() > end_s:
            raise TimeoutError("the stage did not come up")
        time.sleep(0.2)


def started(stack: ExitStack) -> tuple[dict[str, int], str]:
    """Start the stage at 1 kHz and the server; return their processes and the address.

    The environment then has their folders, so that clients of this process find the stage.
    """
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="pz-")))
    os.environ.update(XDG_RUNTIME_DIR=str(folder), XDG_STATE_HOME=str(folder))
    page = folder / "page.txt"
    pids = {"supervisor": start_stage(stack, folder, STAGE)}
    with page.open("w") as out:
        pids["page"] = _start(stack, ("web", "--port", "0"), out)
    wait_until_up(dict(os.environ), page)
    return pids, page.read_text(encoding="utf-8").strip()


def start_stage(stack: ExitStack, folder: Path, name: str) -> int:
    """Start a simulated stage at 1 kHz, which ends with the stack; return its supervisor."""
    config = folder / f"{name}.yaml"
    text = (CONFIG / "simulated.yaml").read_text(encoding="utf-8")
    text = text.replace("rate_hz: 200", f"rate_hz: {RATE_HZ}")
    config.write_text(text.replace("models/", f"{CONFIG}/models/"), encoding="utf-8")
    return _start(stack, ("run", str(config)), subprocess.DEVNULL)


def _start(stack: ExitStack, arguments: Sequence[str], out: TextIO | int) -> int:
    process = subprocess.Popen(  # noqa: S603 - ours
        (*PIEZOD, *arguments), stdout=out, stderr=subprocess.DEVNULL
    )
    stack.enter_context(process)
    stack.callback(process.terminate)
    return process.pid


def main() -> None:
    """Measure and print."""
    with ExitStack() as stack:
        pids, url = started(stack)
        asyncio.run(use(url, pids))


if __name__ == "__main__":
    main()
