"""What a configuration may say about an MDT amplifier."""

from pydantic import Field

from piezod_drivers.serial_line.options import PortOptions, TimeoutMs


class MdtOptions(PortOptions):
    """Options of `thorlabs_mdt`; the model, and how it talks, is found out when it is opened."""

    timeout_ms: TimeoutMs = Field(default=100.0, description="How long to wait for each reply, ms.")
