"""The typed client of a running daemon, with which scripts and other programs move a stage."""

from piezod.client.async_stage_client import AsyncStageClient
from piezod.client.places import find_socket, running_stages
from piezod.client.stage_client import StageClient
from piezod.client.stage_group import StageGroup

__all__ = ["AsyncStageClient", "StageClient", "StageGroup", "find_socket", "running_stages"]
