"""Everything with time and processes: loop process, supervisor, service, stores."""
