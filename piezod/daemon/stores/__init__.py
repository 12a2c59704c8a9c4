"""What the supervisor keeps on disk: parameters, recordings, the audit log."""
