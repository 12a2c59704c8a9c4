"""Known devices, as data: `advantech.py`, `icp_das.py`, `labjack.py`, `wago.py`, `waveshare.py`.

`profile.py` defines the form of this data. `labjack_stream.py` has the stream of LabJacks.
"""

from typing import Final

from piezod_drivers.modbus.profiles.advantech import ADVANTECH
from piezod_drivers.modbus.profiles.icp_das import ICP_DAS
from piezod_drivers.modbus.profiles.labjack import LABJACK
from piezod_drivers.modbus.profiles.profile import ModbusProfile
from piezod_drivers.modbus.profiles.wago import WAGO
from piezod_drivers.modbus.profiles.waveshare import WAVESHARE

PROFILES: Final[dict[str, ModbusProfile]] = {
    profile.name: profile for profile in (*LABJACK, *ADVANTECH, *ICP_DAS, *WAGO, *WAVESHARE)
}
