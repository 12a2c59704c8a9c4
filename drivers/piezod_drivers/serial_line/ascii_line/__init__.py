"""Any device that speaks in lines of text: the configuration has its commands and replies.

`fields.py` has the single options, `rules.py` the rules that concern several of them. Commands are
`templates.py`, replies are `patterns.py`; `ambiguity.py` finds out whether matching a pattern may
take long.
"""
