"""Commands that operate and move a stage."""
