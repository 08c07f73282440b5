"""Reasons why no object is found in what cameras see, as words that can be counted."""

OF_FRAME = (
    "empty_cloud",
    "unit_is_not_metres",
    "plane_not_found",
    "upside_down",
    "table_tilted",
    "table_not_at_base_height",
)
"""Those of clouds whose frame may not be the base's."""

WORDS = {
    "empty_cloud": "the cloud holds too few points to be a scene",
    "unit_is_not_metres": "the coordinates are too large for metres: millimetres? scale them by 0.001, or say "
    "--unit mm",
    "plane_not_found": "no level plane that could be the table: is the cloud in the robot base frame, z up?",
    "upside_down": "the points lie below the table: z must point up in the robot base frame",
    "table_tilted": "the table is tilted in the frame of the robot's base too far to be levelled: is the cloud in "
    "that frame?",
    "table_not_at_base_height": "the table is not at the height above the robot's base that the cell has it at "
    "(table_height)",
    "no_object_on_the_table": "nothing stands on the table within the workspace",
    "nothing_near_the_point": "no object near the point that was named",
    "nothing_marked": "nothing that stands on the table is in the box or the mask",
    "several_objects": "several objects are in the workspace: point at the one that is meant by a point near it, a "
    "box or a mask",
    "out_of_reach": "the object stands outside the workspace of the arm",
}
"""Reason of recorded clouds -> what it means and what to do."""


class NoTargetError(Exception):
    """No object is found: the reason, a key of `WORDS`, and its figures."""

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(reason, detail)
        self.reason = reason
        self.sentence = f"{WORDS[reason]} ({detail})" if detail else WORDS[reason]
