"""What people look at: the HTML report of a run, the live screen, the closing table."""
