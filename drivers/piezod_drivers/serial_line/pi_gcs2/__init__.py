"""PI controllers with GCS 2.0, the second General Command Set: E-517, E-709, E-727, E-754, ….

`player.py` plays tables with the wave generators and the data recorder. `wave_requests.py` has the
exchanges outside of the loop. The commands are from the E-727's
manual E727T0005, pages 66 to 108, and from the public sources of PIPython and bliss. Not confirmed:
the unit of a wave in open loop, the voltage after the last cycle, the instant of a sample within
its servo cycle. The sizes of a controller are asked from it.
"""
