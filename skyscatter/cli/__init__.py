"""The command line; one module a sub-command, and nothing heavy imported before a command needs it."""
