"""The `piezod` command: only this package prints, and only this package chooses exit codes."""
