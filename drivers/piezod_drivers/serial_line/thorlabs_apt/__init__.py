"""Thorlabs' APT protocol: amplifiers KPZ101 and TPZ001, strain gauge readers KSG101 and TSG001.

Formats after the public sources of thorlabs-apt-protocol (yaq), pylablib and the EPICS module
thorlabs-apt-motor; not confirmed on hardware. Messages have no checksum and no number.
"""
