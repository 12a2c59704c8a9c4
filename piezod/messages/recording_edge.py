"""The edge that starts a recording."""

from typing import Annotated

from pydantic import Field

from piezod.config.fields import ConfigModel, Quantity
from piezod.config.quantities import Name

MOST_BEFORE_S = 10.0
"""The loop keeps its cycles for 16 s, or shorter if it is fast and has many axes."""


class RecordingEdge(ConfigModel):
    """A rising edge of a line, which starts a recording, and the end of the recording."""

    line: Name = Field(description="Name of the line, in `lines:` of the configuration.")
    before_s: Annotated[float, Quantity(0, MOST_BEFORE_S, "s")] = Field(
        default=0.0, description="Time before the edge that is recorded, too, s."
    )
    duration_s: Annotated[float, Quantity(1e-3, 1e6, "s")] | None = Field(
        default=None, description="Time from the edge to the end, s; default: the falling edge."
    )
