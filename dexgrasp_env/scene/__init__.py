"""The scene: table, lights, robot and object put together into one model."""
