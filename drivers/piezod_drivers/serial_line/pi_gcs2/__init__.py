"""PI controllers with GCS 2.0, the second General Command Set: E-517, E-709, E-727, E-754, …."""
