"""The command line. Each command is a thin module with `main(argv) -> exit code`."""
