"""Exit codes."""

from dexgrasp.runs import interrupt

OK, ANSWER_IS_NO, BAD_INPUT, INTERRUPTED, INTERNAL_ERROR = 0, 1, 2, interrupt.EXIT_CODE, 70
