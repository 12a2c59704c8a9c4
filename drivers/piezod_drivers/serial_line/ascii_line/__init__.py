"""Any device that speaks in lines of text: its commands and answers are written in YAML.

Files: `options.py` is what a configuration may say, `templates.py` are the commands, `patterns.py`
the answers and why none of them can take long, `codec.py` puts both to work, `dialogue.py` says
it in order, `stream.py` listens to a sensor that sends unasked, `driver.py` leads to all of it.
`emulator.py` holds two devices for which there are examples.
"""
