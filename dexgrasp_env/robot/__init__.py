"""The robot: Panda arm and Allegro hand as MJCF, their names and limits."""
