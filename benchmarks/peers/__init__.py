"""Other people's methods beside those of piezod, on the same records."""
