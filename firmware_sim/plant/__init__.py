"""The world around the board: trajectories, inertial sensors, recordings and scenarios."""
