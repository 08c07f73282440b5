"""Results as people read them: tables, plots, the paper's figures beside ours."""
