"""Files that the supervisor keeps: parameters, recordings, flight records, the audit log."""
