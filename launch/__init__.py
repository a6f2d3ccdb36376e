"""What a user types. Each command is a thin module with `main(argv) -> exit code`."""
