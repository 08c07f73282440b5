"""Reasons why no object is found in what cameras see, as words that can be counted."""

OUT_OF_VIEW = "object_out_of_view"
TOO_FEW = "too_few_points"
NO_PLANE = "plane_not_found"
REASONS = (OUT_OF_VIEW, TOO_FEW, NO_PLANE)
"""Those of simulated depth images."""

EMPTY = "empty_cloud"
UNIT = "unit_is_not_metres"
UPSIDE_DOWN = "upside_down"
TILTED = "table_tilted"
TABLE_HEIGHT = "table_not_at_base_height"
NO_OBJECT = "no_object_on_the_table"
NOTHING_NEAR = "nothing_near_the_point"
NOTHING_MARKED = "nothing_marked"
SEVERAL = "several_objects"
OUT_OF_REACH = "out_of_reach"

OF_FRAME = (EMPTY, UNIT, NO_PLANE, UPSIDE_DOWN, TILTED, TABLE_HEIGHT)
"""Those of clouds whose frame may not be the base's."""

WORDS = {
    EMPTY: "the cloud holds too few points to be a scene",
    UNIT: "the coordinates are too large for metres: millimetres? scale them by 0.001, or say --unit mm",
    NO_PLANE: "no level plane that could be the table: is the cloud in the robot base frame, z up?",
    UPSIDE_DOWN: "the points lie below the table: z must point up in the robot base frame",
    TILTED: "the table is tilted in the frame of the robot's base too far to be levelled: is the cloud in that frame?",
    TABLE_HEIGHT: "the table is not at the height above the robot's base that the cell has it at (table_height)",
    NO_OBJECT: "nothing stands on the table within the workspace",
    NOTHING_NEAR: "no object near the point that was named",
    NOTHING_MARKED: "nothing that stands on the table is in the box or the mask",
    SEVERAL: "several objects are in the workspace: point at the one that is meant by a point near it, a box or a mask",
    OUT_OF_REACH: "the object stands outside the workspace of the arm",
}
"""Reason of recorded clouds -> what it means and what to do."""


class NoTargetError(Exception):
    """No object is found: the reason, a key of `WORDS`, and its figures."""

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(reason, detail)
        self.reason = reason
        self.sentence = f"{WORDS[reason]} ({detail})" if detail else WORDS[reason]
