"""The maker's client of an NV200/D plays a waveform: python nv200_waveform_client.py PORT.

Plays two cycles of a sine of 100 points from 20 to 60 V in open loop, with the data recorder beside
it, and prints in JSON what the device at this serial port reports.
"""

import asyncio
import json
import math
import sys

from nv200.data_recorder import DataRecorder, DataRecorderSource, RecorderAutoStartMode
from nv200.nv200_device import NV200Device
from nv200.serial_protocol import SerialProtocol
from nv200.shared_types import ModulationSource, PidLoopMode
from nv200.waveform_generator import WaveformGenerator, WaveformUnit

N_POINTS, SAMPLE_MS = 100, 0.5


async def main(port: str) -> None:
    """Play the waveform and print the report."""
    device = NV200Device(SerialProtocol(port))
    await device.connect()
    await device.pid.set_mode(PidLoopMode.OPEN_LOOP)
    await device.move_to_voltage(40.0)
    generator, recorder = WaveformGenerator(device), DataRecorder(device)
    wave = [40.0 + 20.0 * math.sin(2 * math.pi * i / N_POINTS) for i in range(N_POINTS)]
    data = WaveformGenerator.WaveformData(values=wave, sample_time_ms=SAMPLE_MS)
    await generator.set_waveform(data, WaveformUnit.VOLTAGE)
    await recorder.set_data_source(0, DataRecorderSource.PIEZO_POSITION)
    await recorder.set_data_source(1, DataRecorderSource.PIEZO_VOLTAGE)
    await recorder.set_autostart_mode(RecorderAutoStartMode.START_ON_WAVEFORM_GEN_RUN)
    taken = await recorder.set_recording_duration_ms(2 * N_POINTS * SAMPLE_MS)
    await recorder.start_recording()
    await generator.start(cycles=2, start_index=0)
    running = await generator.is_running()
    await generator.wait_until_finished()
    await recorder.wait_until_finished()
    positions, voltages = await recorder.read_recorded_data()
    held = await generator.read_waveform_buffer(0, 5, WaveformUnit.VOLTAGE)
    loop = await generator.get_loop_settings()
    value = await recorder.read_recorded_value(1, 0)
    single = await recorder.read_single_value_from(DataRecorderSource.PIEZO_VOLTAGE)
    await device.set_modulation_source(ModulationSource.SET_CMD)
    report = {
        "wave": wave,
        "held": held,
        "loop": loop,
        "running": running,
        "sample_ms": 1000.0 / taken.sample_freq,
        "positions": positions.values,
        "voltages": voltages.values,
        "sources": [positions.source.value, voltages.source.value],
        "value": value,
        "single": single,
        "setpoint": await device.get_setpoint(),
    }
    await device.close()
    print(json.dumps(report))


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
