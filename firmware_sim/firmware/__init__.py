"""What is burnt into the board: telemetry and the navigation program."""
