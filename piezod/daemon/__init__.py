"""Everything with time and processes: the loop process, its supervisor, the service."""
