"""What all tests share."""

from hypothesis import settings

# The same examples in every run, few of them, and no time limits: a loaded machine changes no verdict.
settings.register_profile("repeatable", derandomize=True, max_examples=60, deadline=None, database=None)
settings.load_profile("repeatable")
