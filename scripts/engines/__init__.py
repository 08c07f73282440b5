"""Other engines than MuJoCo for the scenes of the environments: takes a compiled model and set-points; never plans."""
