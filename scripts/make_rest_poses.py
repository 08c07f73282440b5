"""Drop every object of the catalogue and write assets/rest_poses/<name>.json.

Run it when a shape or a mass of the catalogue changes: python scripts/make_rest_poses.py [NAME ...]
"""

import sys
from pathlib import Path

from dexgrasp_env.objects.catalogue import CATALOGUE
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.objects.rest_poses import find_rest_poses, write_poses

FOLDER = Path(__file__).resolve().parents[1] / "assets" / "rest_poses"


def main(names: list[str]) -> None:
    """Write the rest poses of `names`, or of the whole catalogue."""
    for name in names or CATALOGUE:
        model = load_object(name)
        poses = find_rest_poses(model)
        write_poses(FOLDER / f"{name}.json", model, poses)
        print(name, *(f"{pose.probability:.3f}" for pose in poses))


if __name__ == "__main__":
    main(sys.argv[1:])
