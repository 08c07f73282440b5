"""Why a grasp cannot be carried out."""


class NoPath(Exception):  # noqa: N818  (it is an outcome, not a defect)
    """A grasp that cannot be carried out.

    Attributes:
        reason: in a word that can be counted, e.g. `approach_blocked`.
        detail: which bodies are in the way and by how much.
    """

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason, self.detail = reason, detail
