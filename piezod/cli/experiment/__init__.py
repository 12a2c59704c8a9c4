"""Commands that run experiments and check their files."""
