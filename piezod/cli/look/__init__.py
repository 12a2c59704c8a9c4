"""Commands that show a stage."""
