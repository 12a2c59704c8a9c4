"""Parts of the emulated Modbus devices.

`unit.py` holds the registers of a device and answers requests, `servers.py` puts them into the
frames of TCP or RTU. `converter.py` connects inputs and outputs to the simulated rig, `watchdog.py`
is the watchdog of a device. `labjack.py` and `io_modules.py` make the single devices.

The stream of a LabJack: `stream.py` scans, `stream_out.py` holds the values to be played,
`stream_buffer.py` the samples to be sent, `digital_outputs.py` the lines that pulse. `flash.py` is
the memory with the constants of the inputs.
"""
