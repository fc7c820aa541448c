"""Wall-time figures. They are printed with their spread and the load of the machine, and never asserted in a test."""
