"""Physics constants of the scene, frozen as v0; the solver's and the table's look stand in assets/scene/arena.xml."""

TIMESTEP = 0.002  # s, one physics step
GRAVITY = 9.81  # m/s^2, MuJoCo's default
CONTROL_STEPS = 25  # physics steps in a control step: 20 Hz
CONTROL_PERIOD = TIMESTEP * CONTROL_STEPS  # s

FRICTION = 0.7  # default sliding friction coefficient of every contact

TABLE_SIZE = (0.70, 1.20, 0.04)  # m, x y z; the top is the plane z = 0
TABLE_CENTRE_X = 0.52  # m
TABLE_ABOVE_FLOOR = 0.75  # m, for the look alone: `Cell` has the height above the robot's base
