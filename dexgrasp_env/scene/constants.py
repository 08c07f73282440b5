"""Physics constants of the scene, frozen as v0.

Elliptic cones, a high friction-to-normal impedance ratio and a stiff friction reference at the fingertips: slip begins
at mu N in every direction and a held object creeps by less than a millimetre in ten seconds. Pyramidal cones are up to
29 % too weak; MuJoCo's defaults drop a 514 g box. Nothing here makes contacts stronger than Coulomb friction.
"""

TIMESTEP = 0.002  # s, one physics step
CONTROL_STEPS = 25  # physics steps in a control step: 20 Hz
CONTROL_PERIOD = TIMESTEP * CONTROL_STEPS  # s

IMPRATIO = 100.0
TOLERANCE = 1e-8
FRICTION = 0.7  # default sliding friction coefficient of every contact
TORSIONAL_FRICTION = 0.005  # m; unused by condim 3, kept for users who raise condim
ROLLING_FRICTION = 0.0002  # m; object on table only: rolling resistance of a can on a hard table

# Fingertip against object: MuJoCo's pair parameters.
TIP_SOLREF = (0.02, 1.0)
TIP_SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)
TIP_SOLREFFRICTION = (0.004, 1.0)

TABLE_SIZE = (0.70, 1.20, 0.04)  # m, x y z; the top is the plane z = 0
TABLE_CENTRE_X = 0.52  # m
TABLE_HEIGHT = 0.75  # m above the floor
