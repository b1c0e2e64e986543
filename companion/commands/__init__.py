"""One thin module a command of the command line: arguments in, one call, text out."""
