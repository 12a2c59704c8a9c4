"""Options of an MDT amplifier."""

from pydantic import Field

from piezod_drivers.serial_line.options import PortOptions, TimeoutMs


class MdtOptions(PortOptions):
    """Options of `thorlabs_mdt`; the model and its protocol are detected at opening."""

    timeout_ms: TimeoutMs = Field(default=100.0, description="Longest wait for each reply, ms.")
