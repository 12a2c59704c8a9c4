"""Parts of the emulated controller: its wave generators and its data recorder.

`wave_generators.py` plays wave tables by the servo clock, `data_recorder.py` records beside them,
`trigger_outputs.py` pulses and counts. `wave_commands.py` has the commands of all, `arguments.py`
reads their arguments, and `arrays.py` writes their replies with many values.
"""
