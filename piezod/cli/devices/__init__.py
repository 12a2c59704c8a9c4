"""Commands for devices without a daemon."""
