"""Commands that measure and fit models of an axis."""
