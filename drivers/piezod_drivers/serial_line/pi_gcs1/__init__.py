"""PI controllers with GCS 1, the first General Command Set: E-816 (E-621, E-625, E-665), E-516."""
