"""The task of lifting, DexGrasp/Lift-v2, and its page."""

from dexgrasp_env.tasks.single import SingleEnv


class LiftEnv(SingleEnv):
    """Pick an object up from a table with an arm and a hand, and hold it.

    ## Description

    A robot stands at a table, a Franka Emika Panda with an Allegro hand where `robot` names no other; one object lies
    on it. The task is solved when the object's lowest point has been at least 10 cm above the table for the last 3 s,
    nothing but the hand has touched it meanwhile, and it is grasped: at the end and for 90 % of that time the thumb and
    the index, middle or ring finger press it with at least 0.5 N each, from opposite sides (more than 90 deg between
    the forces). Control runs at 20 Hz, physics at 500 Hz; m, rad, kg, N, in the world frame: x forward, z up, table top
    at z = 0.

    ## Action Space

    A `Box(-1, 1, (n,), float32)`; entries outside are clipped. They become
    set-points of the 23 joint servos, which move evenly within the control step, within the joints' velocity limits:
    panda_joint1-7, then index, middle, ring and thumb with four each. Another robot has sizes of its own:
    `dexgrasp list envs --robot FILE`.

    | control_mode | n | Entries | Meaning |
    | --- | --- | --- | --- |
    | `joint_position` | 23 | 0-22 | set-points; -1 and 1 are the ends of the joint range |
    | `joint_delta` | 23 | 0-22 | change of the set-points; 1 is the velocity limit times 50 ms |
    | `ee_delta` | 22 | 0-2 | translation of the palm; 1 is 25 mm |
    | | | 3-5 | rotation vector of the palm; 1 is 0.125 rad |
    | | | 6-21 | set-points of the hand's joints; -1 and 1 are the ends of the range |
    | `grasp` | 7 | 0-1 | palm along the object's narrowest level direction and across it; 1 is 50 mm from the middle |
    | | | 2 | palm above the object's top; -1 and 1 are 20 mm below (at least 120 mm above the table) and 240 mm above |
    | | | 3-4 | turned, 1 is 0.3 rad; thumb tilted up, -1 and 1 are -0.1 and 0.3 rad |
    | | | 5-6 | closing of index and middle finger, and of the thumb; -1 is open |
    | `grasp_once` | 7 | 0-6 | a whole grasp there: the hand opens, comes down, closes, lifts 200 mm and holds |
    | `table_grasp_once` | 7 | 0-6 | the same, palm anywhere: x, y, height, any turn within 90 deg, tilt, closing |

    The last three are of the grasp space, for the Allegro hand: set-points that a low level goes to by `ee_delta`,
    about where the object truly is, so they are for `state` and `features`; what lies beyond -1 and 1 is mirrored
    there. A whole grasp ends the episode: once held for 3 s, or 1.5 s after closing with the object not up.
    `table_grasp_once` has x in 0.39-0.63, y in +-0.23, palms 120 to 250 mm above the table. `hold` repeats an action
    for so many control steps; `step` returns what they gained together.

    ## Observation Space

    A `Dict`. Every mode has:

    | Key | Shape | Type | Meaning |
    | --- | --- | --- | --- |
    | `joint_positions` | (23,) | float32 | rad |
    | `joint_velocities` | (23,) | float32 | rad/s |
    | `joint_targets` | (23,) | float32 | rad, set-points |
    | `fingertip_positions` | (12,) | float32 | m, centres of the tips: index, middle, ring, thumb |
    | `palm_pose` | (7,) | float32 | m and quaternion wxyz of the palm frame |

    `state` adds what no camera tells, the others what four simulated depth cameras see:

    | Key | Shape | Type | obs_mode | Meaning |
    | --- | --- | --- | --- | --- |
    | `object_pose` | (7,) | float32 | `state` | centre of mass m and quaternion wxyz |
    | `object_velocity` | (6,) | float32 | `state` | m/s, and rad/s in the object frame |
    | `object_size` | (3,) | float32 | `state` | m, sides of its box along its own axes |
    | `object_mass` | (1,) | float32 | `state` | kg |
    | `fingertip_forces` | (12,) | float32 | `state` | N, contact force of each tip on the object |
    | `progress` | (2,) | float32 | `state` | m, lowest point above the table; share of the 3 s held, 0 to 1 |
    | `variation` | (6,) | float32 | `state` | mass factor, friction, size factor, gain factor, latency s, noise rad |
    | `cloud` | (1024, 3) | float32 | `pointcloud` | m, points of the object |
    | `cloud_normals` | (1024, 3) | float32 | `pointcloud` | unit normals out of the object |
    | `cloud_mask` | (1024,) | int8 | `pointcloud` | 1 where a point counts |
    | `table_plane` | (5,) | float32 | `pointcloud` | normal, offset m and RMS m of the table as seen |
    | `depth` | (4, 120, 160) | float32 | `depth`, `rgbd` | m along the optical axis, 0 where nothing was measured |
    | `rgb` | (4, 120, 160, 3) | uint8 | `rgbd` | colours, drawn without shadows |

    `grasp_state`, (7,) float32, joins the state in the grasp space: the action that would leave palm and hand where
    they are. `obs_mode="features"` is one array instead, a `Box(-10, 10, (92,))`, seen from the arm's base turned to
    where the object lay: set-points, tips and palm about the object (10 is 1 m), palm's rotation, time (1 is 5 s),
    forces, height, share held; and in spreads, of the object as it first lay, place, reach in 12 level directions,
    height, rotation, sides, mass, friction; with `grasp` also `grasp_state`. Where an action is a whole grasp it is the
    30 of the object alone.

    Keys are in alphabetical order. `info` has at reset and at every step: `is_success`, `is_grasped`, `is_stable`
    (less than 2.5 cm and 15 deg of motion in the hand's frame since the object left the table), `stage` (untouched,
    touched, lifted, dropped, held), `failure` (empty while there is none), `object`, `object_height` m, `object_slip`
    m, `object_tilt` rad, `object_shift` m (in the palm's frame since the disturbance began), `held_seconds`,
    `disturbance` (none, before, running, over), `variation` (what was drawn), `mujoco_warnings` (names with spaces
    between), `reward_terms`. With cameras, in the order of the images: `perception_cameras` (names),
    `perception_T_world_camera` (as calibrated), `perception_intrinsics` (fx, fy, cx, cy in pixels), and
    `perception_failure`.

    ## Rewards

    `sparse` is 1 while the task is solved, else 0. `dense` is what the weighted sum of these terms, each in [0, 1], has
    gained in the control step, and what it has lost is taken away; `best` is what it gains above its highest so far:
    a grasp that misses tells how near it came:

    | Term | Weight | Meaning |
    | --- | --- | --- |
    | `reach` | 5.0 | thumb, index and middle tips within 2 cm of the object's box, 0 from 62 cm |
    | `close` | 10.0 | tips within 2 mm of the box, falling off over 6 cm, with its inside between thumb and fingers |
    | `contact` | 5.0 | thumb and fingers press from opposite sides, full at 0.5 N |
    | `squeeze` | 5.0 | the lesser of the two forces over what bears the weight by friction |
    | `lift` | 15.0 | height of the lowest point over 10 cm, times `contact` |
    | `hold` | 10.0 | time held in a grasp, of the last 3 s; a disturbance must be over |
    | `success` | 50.0 | 1 from the first success on |

    The object's box has the sides `object_size`, about the centre of mass. The return of an episode is the sum at its
    end less that at its start: at most 50 without success, for however long; at least 50 with it, about 100 where the
    object is still held at the end. An episode that fails (see below) loses all but `success`.

    ## Starting State

    The arm at its ready posture, the hand open. An object of `objects` is drawn, then its rest pose by probability (or
    the one in which the catalogue presents it), its place (x in 0.42-0.60, y in +-0.20) and its turn about the
    vertical; it settles for 0.2 s.
    `reset(options={"object": NAME, "object_pose": [x, y, z, qw, qx, qy, qz]})` sets them; the pose must be over the
    table, not inside it, free of the robot and in reach. `joints` (n,) rad beside a pose begin with the robot there.

    ## Episode End

    Terminates when the object leaves the workspace (`failure` is `object_lost`) or numbers go wrong
    (`simulation_diverged`); truncates after 300 steps, 15 s. Success ends nothing: the object is to stay up. Pushes or
    shaking begin once the object has been held for 1 s, and success is then the 3 s hold after their end with the
    object moved at most 6 cm in the palm's frame. That takes `disturbance_steps` (80 pushed, 40 shaken):
    `LiftPushed-v2` has 380 steps; elsewhere, as with a `frame_skip` below 25, a warning names a `max_episode_steps`.

    ## States

    `get_state()` returns everything the episode's future depends on; `set_state(state)` goes on from there bit for bit,
    also in another environment of the same settings, as `copy.deepcopy` and `pickle` do.
    `reset(options={"state": state})` begins an episode there. Gymnasium's `TimeLimit` keeps a count of its own, which
    a vector environment restores and a single one does not. `observe()` returns observation and info of the present.
    `model`, `data` and `dt` are MuJoCo's.

    ## Arguments

    | Argument | Default | Valid |
    | --- | --- | --- |
    | `objects` | `'ycb6'` | name, set (`ycb6`, `seen`, `familiar`, `novel`, `all20`), mesh file, or a list of these |
    | `obs_mode` | `'state'` | `state`, `features`, `pointcloud`, `depth`, `rgbd`, or `state+` one of the last three |
    | `control_mode` | `'joint_delta'` | `joint_position`, `joint_delta`, `ee_delta`, `grasp`, `[table_]grasp_once` |
    | `reward_mode` | `'dense'` | `dense`, `sparse`, `best` |
    | `robot` | `None` | a cell, a robot, or a file of either; None: the simulated cell |
    | `mount` | `None` | `palm_normal`, `fingers_along`; None: the robot's own |
    | `friction` | `None` | sliding, of every contact, above 0 and up to 2; None: 0.7, or a set file's |
    | `mass` | `1.0` | factor on the object's mass, above 0 and up to 100 |
    | `presentation` | `'rest'` | `rest`; `upright`: standing as built where that is stable, else at rest |
    | `disturbance` | `None` | `none`, `pushed`, `shaken`, `moved`, `belt`, or `kind` and `size`: `Disturbance` |
    | `object_pose` | `None` | ranges `x`, `y`, `yaw`, and `rest_pose` (`any`, `each`, `likely`, a number) |
    | `randomisation` | `None` | ranges of `mass`, `size`, `gain` (factors), `friction`, `latency` s, `joint_noise` |
    | `views` | `4` | names of the cameras that look, in the order of the images, or how many to draw at reset |
    | `calibration` | `None` | `position` m and `rotation` rad: one rigid error of all cameras, drawn at reset |
    | `sensor` | `'realistic'` | `realistic`, `captured`, `none`, or settings of `SensorModel` |
    | `observe` | `'step'` | `step`; `10hz`; `reset`: cameras look once; `clear`: and whenever the arm is home |
    | `mesh_scale` | `1.0` | factor from a mesh file's unit to metres |
    | `mesh_mass` | `None` | kg of a mesh file's object; None for 400 kg/m3 |
    | `render_mode` | `None` | `human`, `rgb_array`, `depth_array` |
    | `render_size` | `(480, 640)` | rows and columns of pictures |
    | `render_camera` | `'front'` | `front`; `grasp`: follows the hand, close by; or one of the depth cameras |
    | `reward_weights` | `None` | weights by term, from 0 on, in place of those above |
    | `frame_skip` | `25` | physics steps of a control step, 5 to 125; limits are steps |
    | `action_scale` | `1.0` | factor, above 0 and up to 1, on what 1 means in actions that are changes |
    | `hold` | `1` | control steps that an action stands for |
    | `reward_scale` | `1.0` | factor on rewards, above 0 |
    | `starts` | `None` | `pregrasps`, or a file of `scripts/pregrasps.py`, on whose way episodes begin |
    | `backend` | `'mujoco'` | `mujoco`; `warp`: mujoco_warp, the extra `gpu` |
    | `device` | `None` | of `warp`: `cuda:0`, `cuda:1`, ..., `cpu`; None: a GPU where there is one |

    ## Version History

    * v2: a dense reward that leads to a grasp and that nothing but success earns in full.
    * v1: withdrawn: hovering earned much.
    """
