"""Between loop and supervisor: the record of a cycle, the shared ring, the command mailbox."""
