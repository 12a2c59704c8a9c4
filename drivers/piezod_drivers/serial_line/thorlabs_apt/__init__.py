"""Thorlabs' APT protocol: amplifiers KPZ101 and TPZ001, strain gauge readers KSG101 and TSG001.

Formats are from the maker's "Host-Controller Communications Protocol", issue 28, and from the
public sources of thorlabs-apt-protocol (yaq), pylablib and the EPICS module thorlabs-apt-motor, and
not confirmed on hardware. Messages have no checksum and no number.

`cube_line.py` is the port, which has to wake the cube. `filtered_line.py` separates unrequested
messages from replies. `session.py` asks and waits for both kinds of cubes. `side_request.py` asks
for a state beside other requests.
"""
