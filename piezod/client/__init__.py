"""The typed client of a running daemon, with which scripts and other programs move a stage."""

from piezod.client.arrival import Arrival
from piezod.client.async_stage_client import AsyncStageClient
from piezod.client.places import find_socket, running_stages
from piezod.client.stage_client import StageClient
from piezod.client.stage_group import StageGroup
from piezod.messages.answers import Answer, AxisStatus, Fault, Status
from piezod.messages.stores import Recording, Recordings
from piezod.messages.telemetry import Telemetry

__all__ = [
    "Answer",
    "Arrival",
    "AsyncStageClient",
    "AxisStatus",
    "Fault",
    "Recording",
    "Recordings",
    "StageClient",
    "StageGroup",
    "Status",
    "Telemetry",
    "find_socket",
    "running_stages",
]
