"""Reports: tables and plots of evaluations, with the paper's figures beside ours."""
