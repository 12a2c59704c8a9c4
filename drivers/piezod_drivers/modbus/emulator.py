"""The emulated Modbus devices, by their profile names."""

from functools import partial
from typing import Final

from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod_drivers.modbus.emulation import io_modules, labjack
from piezod_drivers.modbus.emulation.labjack import LabJackModel
from piezod_drivers.modbus.profiles.labjack_stream import PORT_DISTANCE


def _labjack(name: str, model: LabJackModel) -> EmulatorPlugin:
    create = partial(labjack.emulator, model)
    return EmulatorPlugin(
        name, f"LabJack {name[-2:].upper()}", "tcp", create, stream_port=PORT_DISTANCE
    )


LABJACK_T4: Final = _labjack("labjack-t4", labjack.T4)
LABJACK_T7: Final = _labjack("labjack-t7", labjack.T7)
LABJACK_T8: Final = _labjack("labjack-t8", labjack.T8)
ADAM_6024: Final = EmulatorPlugin("adam-6024", "Advantech ADAM-6024", "tcp", io_modules.adam_6024)
ADAM_4024: Final = EmulatorPlugin(
    "adam-4024", "Advantech ADAM-4024 at address 1, outputs only", "serial", io_modules.adam_4024
)
ICPDAS: Final = EmulatorPlugin(
    "icpdas", "ICP DAS M-7017 at address 1 and M-7024R at address 2", "serial", io_modules.icpdas
)
WAGO_750: Final = EmulatorPlugin(
    "wago-750", "WAGO 750 with 4 inputs and 4 outputs of 10 V", "tcp", io_modules.wago_750
)
WAVESHARE: Final = EmulatorPlugin(
    "waveshare",
    "Waveshare Analog Input 8CH (B) at address 1, Analog Output 8CH (B) at 2",
    "serial",
    io_modules.waveshare_b,
)
